"""The command line: one function a command, no more than reading options and calling the library."""

from __future__ import annotations

import os
import sys
import warnings

import typer
from threadpoolctl import threadpool_limits

from gridfold.cli import analysis, curves, reduced, run, study, study_results
from gridfold.cli.calibrate import calibrate
from gridfold.cli.check_device import check_device
from gridfold.cli.console import EXIT_CODES, ExitCode, err
from gridfold.cli.option_groups import flat
from gridfold.cli.reproduce import reproduce
from gridfold.errors import GridfoldError, GridfoldWarning
from gridfold.version import __version__

app = typer.Typer(
    name="gridfold",
    help="Transient-stability simulation of power systems.",
    epilog=EXIT_CODES,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
for command in (
    run.demo,
    run.simulate,
    curves.plot,
    curves.compare,
    analysis.info,
    analysis.eigenvalues,
    analysis.cct,
    reduced.partition,
    reduced.reduce,
    check_device,
    calibrate,
    reproduce,
    study.init,
    study.run,
    study_results.show,
    study_results.report,
    study_results.check,
):
    app.command()(flat(command))


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"gridfold {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_show_version, is_eager=True, help="Print the version."
    ),
) -> None:
    """Options of the command itself."""


def main() -> None:
    """Run the command; bad input ends it with a message and exit code 2, without a traceback."""
    # Pictures go to files: a backend of windows or notebooks may not even be there.
    os.environ["MPLBACKEND"] = "agg"
    try:
        with threadpool_limits(limits=1, user_api="blas"), warnings.catch_warnings():
            # The commands say themselves what there is to say.
            warnings.simplefilter("ignore", GridfoldWarning)
            app()
    except GridfoldError as error:
        err.print(f"gridfold: error: {error}", style="red")
        sys.exit(ExitCode.BAD_INPUT)
