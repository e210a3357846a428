"""The command `comwalk certify`: the certificate of a robot's gains."""

from __future__ import annotations

import json as json_format
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from ..certificates import Certificate
from ..config import CertifyConfig
from ..config_files import make_config
from ..errors import ParameterError
from ..setup import build_certificate
from .certificate_table import (
    Section,
    flags_to_walk_with,
    numbers_of_certificate,
    sections_of_certificate,
)
from .options import flags_of, given_flags, with_flags
from .output import print_json

_Flags = flags_of(CertifyConfig, ("robot",))


@with_flags(_Flags)
def certify(
    robot: Annotated[
        str | None,
        Parameter(help="Robot of `comwalk robots`, or path of a URDF or MJCF file."),
    ] = None,
    /,
    *,
    flags: Any = None,
    config: Annotated[
        Path | None, Parameter(help="TOML file with the same keys; flags win.")
    ] = None,
    run: Annotated[
        Path | None,
        Parameter(help="Folder of a walk: compare what it shows with its bounds."),
    ] = None,
) -> int:
    """Tell what the gains of a robot guarantee, before it moves.

    Gains, filter and loop are those of `comwalk walk` unless given. Exit code 0 if the
    gains are stable, 1 if they are not; then it tells what to change. With --run, what
    disturbed a walk, the bounds that this implies, and the errors that were observed;
    exit code 1 if one exceeds its bound.
    """
    given = given_flags(flags) | ({} if robot is None else {"robot": robot})
    if run is not None:
        return _compare(run, given, config)
    settings = make_config(CertifyConfig, given, config)
    certificate = build_certificate(settings)
    numbers = {"robot": settings.robot, **numbers_of_certificate(certificate)}
    if settings.design is not None:
        numbers["flags"] = flags_to_walk_with(certificate)
    if settings.out is not None:
        numbers["files"] = _written(certificate, numbers, Path(settings.out))
    if settings.json:
        print_json(numbers)
    else:
        _print(certificate, numbers)
    return 0 if certificate.stable else 1


def _compare(run: Path, given: dict[str, Any], config: Path | None) -> int:
    """Compare a walk with its bounds; return the exit code."""
    from ..certificates import lines_of_observed, numbers_of_observed, observe_run

    others = [name for name in given if name != "json"]
    if others or config is not None:
        raise ParameterError(
            "--run takes robot, gains and loop from the run; leave out "
            + (others[0] if others else "--config")
        )
    axes = observe_run(run)
    if given.get("json"):
        print_json(numbers_of_observed(axes))
    else:
        print("\n".join(line for x in axes for line in lines_of_observed(x)))
    compared = [c for x in axes for c in (x.ideal, x.loop) if c is not None]
    return 0 if all(c.holds for c in compared) else 1


def _written(
    certificate: Certificate, numbers: dict[str, Any], folder: Path
) -> list[str]:
    """Write the numbers and the picture; return the files."""
    from ..runs import prepare_folder, write_file
    from ..views import plot_gain_plane

    path = prepare_folder(folder)
    text = json_format.dumps(numbers, indent=2, allow_nan=False)
    write_file(path / "certificate.json", text + "\n")
    plot_gain_plane(certificate, path / "gains.png", title=str(numbers["robot"]))
    return [str(path / name) for name in ("certificate.json", "gains.png")]


def _print(certificate: Certificate, numbers: dict[str, Any]) -> None:
    """Print the verdict, the table, and what was written."""
    print(f"{numbers['robot']}: {certificate.verdict}")
    if "flags" in numbers:
        print(f"walk with: {numbers['flags']}")
    print()
    sections = sections_of_certificate(certificate)
    head = Section("", [("", *(x.name for x in certificate.axes))])
    columns = zip(*(row for s in [head, *sections] for row in s.rows), strict=True)
    widths = [max(map(len, column)) for column in columns]
    for title, rows in [head, *sections]:
        if title:
            print(f"\n{title}")
        for name, *cells in rows:
            texts = [c.rjust(w) for c, w in zip(cells, widths[1:], strict=True)]
            print("  ".join(["", name.ljust(widths[0]), *texts]))
    for name in numbers.get("files", ()):
        print(f"written to {name}")
