"""What a run leaves behind: columns, summary, saved folder, ROS 2 messages, exports."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .columns import Log as Log
    from .columns import save_columns as save_columns
    from .columns import write_npz as write_npz
    from .export import export_csv as export_csv
    from .export import export_parquet as export_parquet
    from .export import export_rosbag2 as export_rosbag2
    from .mcap_log import MCAP_NAME as MCAP_NAME
    from .mcap_log import McapLog as McapLog
    from .mcap_log import Recorder as Recorder
    from .mcap_log import save_mcap as save_mcap
    from .run_data import Record as Record
    from .run_data import RunData as RunData
    from .run_data import read_columns as read_columns
    from .run_data import read_summary as read_summary
    from .run_data import record_of as record_of
    from .run_log import ROWS_NAME as ROWS_NAME
    from .run_log import LogFacts as LogFacts
    from .run_log import inspect as inspect
    from .run_log import log_path as log_path
    from .run_log import repair as repair
    from .summary import summarize as summarize
    from .summary import versions as versions

__getattr__, __dir__ = exports_of(__name__, __file__)
