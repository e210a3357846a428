"""Try robots on walks, dances, floors, pushes and loads."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .cases import ABLATIONS as ABLATIONS
    from .cases import DEFAULT as DEFAULT
    from .cases import OPEN_LOOP as OPEN_LOOP
    from .cases import PUSH_SHARES as PUSH_SHARES
    from .cases import TORQUE as TORQUE
    from .cases import Ablation as Ablation
    from .cases import Case as Case
    from .cases import all_cases as all_cases
    from .cases import pushes as pushes
    from .ledger import Job as Job
    from .ledger import chosen as chosen
    from .ledger import jobs_of as jobs_of
    from .ledger import known_jobs as known_jobs
    from .ledger import run_jobs as run_jobs
    from .table import Findings as Findings
    from .table import tables_of_findings as tables_of_findings
    from .table import write_report as write_report
    from .trials import REPORT_SEEDS as REPORT_SEEDS
    from .trials import TUNING_SEEDS as TUNING_SEEDS
    from .trials import perform as perform

__getattr__, __dir__ = exports_of(__name__, __file__)
