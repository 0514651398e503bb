"""The command line: one function a command, no more than reading options and calling the library."""

from __future__ import annotations

import os
import sys
import warnings

import typer

from gridfold.cli.exit_codes import EXIT_CODES, ExitCode
from gridfold.cli.late_commands import Late, late_group
from gridfold.errors import GridfoldError, GridfoldWarning
from gridfold.version import __version__

_JOBS = {"--workers": "--jobs"}

COMMANDS = {
    "demo": Late(
        "run",
        "Simulate a three-phase fault at bus 3 of the built-in NPCC system, print and draw it.",
    ),
    "simulate": Late("run", "Simulate a disturbance on the detailed or a reduced model of CASE."),
    "plot": Late("curves", "Draw the table of a run that simulate or a study has written."),
    "compare": Late("curves", "Compare two runs, or two studies: where they differ most."),
    "info": Late(
        "analysis",
        "Print what a case consists of, its operating point and its dynamic devices.",
    ),
    "convert": Late(
        "convert", "Write a case as a folder of tables or as files of PSS/E, with edits if any."
    ),
    "eigenvalues": Late(
        "analysis",
        "Eigenvalues, damping ratios and participation factors at the operating point.",
    ),
    "cct": Late(
        "clearing",
        "Critical clearing times of three-phase faults, of a few places or of the whole grid.",
        _JOBS,
    ),
    "partition": Late(
        "reduced",
        "Print study and external area, tie lines, and the column norms of external machines.",
    ),
    "reduce": Late(
        "reduced",
        "Linearize and reduce the external area; print its order, error bound and singular values.",
        {"--save": "--out"},
    ),
    "check-device": Late(
        "check_device", "Try a device model of your own on a small case before it meets a grid."
    ),
    "calibrate": Late(
        "calibrate",
        "Find the thresholds with which all rotor-angle errors in the study area stay below a limit.",
        _JOBS,
    ),
    "reproduce": Late(
        "reproduce",
        "Compute the tables and figures of Osipov & Sun on npcc, beside the paper's numbers.",
    ),
    "init": Late("study", "Write a study file, or a sample plan, with a comment on every key."),
    "run": Late("study", "Run a study: every contingency, on all cores or a cluster."),
    "sample": Late("sample", "Make a labelled data set of operating points and faults."),
    "show": Late("study_results", "Show the results of a study, also while it runs."),
    "report": Late(
        "study_results",
        "Write the report of a study or of clearing times: one page that needs no network.",
    ),
    "check": Late("study_results", "Read all of a study's results and say which are whole."),
    "warm-up": Late(
        "warm_up", "Compile once what runs need, so that the first one starts at once."
    ),
}

app = typer.Typer(
    name="gridfold",
    cls=late_group(COMMANDS),
    help="Transient-stability simulation of power systems.",
    epilog=EXIT_CODES,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"gridfold {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    ctx: typer.Context,
    version: bool = typer.Option(
        False, "--version", callback=_show_version, is_eager=True, help="Print the version."
    ),
) -> None:
    """Limit BLAS to one thread; the command, and NumPy with it, has been imported now."""
    from threadpoolctl import threadpool_limits

    ctx.with_resource(threadpool_limits(limits=1, user_api="blas"))


def main() -> None:
    """Run the command; bad input ends it with a message and exit code 2, without a traceback."""
    # Pictures go to files: a backend of windows or notebooks may not even be there.
    os.environ["MPLBACKEND"] = "agg"
    try:
        with warnings.catch_warnings():
            # The commands say themselves what there is to say.
            warnings.simplefilter("ignore", GridfoldWarning)
            app()
    except GridfoldError as error:
        from gridfold.cli.console import err

        err.print(f"gridfold: error: {error}", style="red")
        sys.exit(ExitCode.BAD_INPUT)
