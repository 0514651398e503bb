"""Files of a user's own exciter, sound and spoilt."""

from __future__ import annotations

from pathlib import Path

#: An exciter with a filter and a limited amplifier that answers MYAVR records.
SOUND = '''\
"""An exciter of one's own."""

from numba import njit

from gridfold.dynamics.blocks import lag, limited_lag
from gridfold.dynamics.device import Bound, Device, Parameter, Role, limits, positions

PARAMETERS = (
    Parameter("mode", "M", "-", Bound.INTEGER),
    Parameter("measuring_time", "TR", "s", Bound.NOT_NEGATIVE),
    Parameter("gain", "KA", "p.u."),
    Parameter("time", "TA", "s", Bound.NOT_NEGATIVE),
    Parameter("lowest", "VMIN", "p.u.", Bound.ANY),
    Parameter("highest", "VMAX", "p.u.", Bound.ANY, default=5.0),
)
SET_POINTS = ("voltage_reference",)
STATES = ("measured", "amplifier")
INPUTS = ("terminal_voltage", "stabilizer_signal")
OUTPUTS = ("field_voltage",)
P = positions(*PARAMETERS, *SET_POINTS, "base_speed")
X, U, Y = positions(*STATES), positions(*INPUTS), positions(*OUTPUTS)


@njit
def amplifier(x, u, p, i):
    v = lag(u[U.terminal_voltage, i], x[X.measured, i], p[P.measuring_time, i])[0]
    error = p[P.voltage_reference, i] + u[U.stabilizer_signal, i] - v
    x_a, ta = x[X.amplifier, i], p[P.time, i]
    return limited_lag(p[P.gain, i] * error, x_a, ta, p[P.lowest, i], p[P.highest, i])


def output(x, u, p, y, dx):
    for i in range(x.shape[1]):
        y[Y.field_voltage, i] = amplifier(x, u, p, i)[0]


def derivative(x, u, p, y, dx):
    for i in range(x.shape[1]):
        dx[X.measured, i] = lag(
            u[U.terminal_voltage, i], x[X.measured, i], p[P.measuring_time, i]
        )[1]
        dx[X.amplifier, i] = amplifier(x, u, p, i)[1]


MINE = Device(
    model="mine",
    title="exciter of one's own",
    role=Role.EXCITER,
    parameters=PARAMETERS,
    set_points=SET_POINTS,
    states=STATES,
    inputs=INPUTS,
    outputs=OUTPUTS,
    output=output,
    derivative=derivative,
    targets=("field_voltage",),
    defaults={"stabilizer_signal": 0.0},
    limits=limits("lowest", "highest", "amplifier"),
    psse_record=("mode", "measuring_time", "gain", "time", "lowest", "highest"),
    psse_names=("MYAVR",),
    psse_icons=1,
)
'''
#: Values of a MYAVR record.
RECORD = (2.0, 0.02, 50.0, 0.05, -20.0, 20.0)


def own_file(folder: Path, *changes: tuple[str, str], name: str = "mine.py") -> Path:
    """The sound exciter with some of its text changed, as a file."""
    text = SOUND
    for before, after in changes:
        assert before in text, before
        text = text.replace(before, after)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def line_of(path: Path, text: str) -> int:
    """The line in which a text stands first."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return next(k for k, line in enumerate(lines, start=1) if text in line)


_EXAMPLE = Path(__file__).parents[1] / "examples" / "psse_study"
RAW = _EXAMPLE / "two_areas.raw"
_SEXS = """{bus} 'SEXS'   1     0.10000      10.000       50.000      0.50000E-01
          0.0000       5.0000    /"""
#: The record in its two forms.
PLAIN = "{bus} 'MYAVR' 1  2 0.02 50.0 0.05 -20.0 20.0 /"
USER_WRITTEN = "{bus} 'USRMDL' 1 'MYAVR' 4 0 1 5 2 0  2 0.02 50.0 0.05 -20.0 20.0 /"


def own_dyr(folder: Path, at_12: str = PLAIN, at_22: str = USER_WRITTEN) -> Path:
    """Dynamic data for :data:`RAW` with these records in place of the SEXS of 12:1 and 22:1."""
    text = (_EXAMPLE / "two_areas.dyr").read_text(encoding="utf-8")
    for bus, record in ((12, at_12), (22, at_22)):
        before = _SEXS.format(bus=bus)
        assert before in text
        text = text.replace(before, record.format(bus=bus))
    path = folder / "own.dyr"
    path.write_text(text, encoding="utf-8")
    return path
