"""The log of a run: columns, summary, saved folder, ROS 2 messages, exports."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .columns import Log as Log
    from .columns import save_columns as save_columns
    from .columns import write_file as write_file
    from .columns import write_npz as write_npz
    from .export import export_csv as export_csv
    from .export import export_parquet as export_parquet
    from .export import export_rosbag2 as export_rosbag2
    from .landings import Landing as Landing
    from .landings import moved_from as moved_from
    from .landings import moved_steps as moved_steps
    from .mcap_file import MCAP_NAME as MCAP_NAME
    from .mcap_file import LogFacts as LogFacts
    from .mcap_file import inspect as inspect
    from .mcap_file import write_mcap as write_mcap
    from .recorder import ROWS_NAME as ROWS_NAME
    from .recorder import Recorder as Recorder
    from .recorder import clear_folder as clear_folder
    from .recorder import log_path as log_path
    from .recorder import prepare_folder as prepare_folder
    from .run_data import Moment as Moment
    from .run_data import RunData as RunData
    from .run_data import Source as Source
    from .run_data import data_of as data_of
    from .run_data import load_run as load_run
    from .run_data import read_columns as read_columns
    from .run_data import read_summary as read_summary
    from .summary import judged as judged
    from .summary import outcome_text as outcome_text
    from .summary import summarize as summarize
    from .summary import versions as versions

__getattr__, __dir__ = exports_of(__name__, __file__)
