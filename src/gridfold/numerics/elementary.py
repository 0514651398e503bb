"""Elementary functions without branches or calls, so that loops over them become vector instructions.

Errors are a few units in the last place. The functions keep the order of their sums, on which their
accuracy rests, whatever the rules of the loops that call them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import intrinsic

from gridfold.numerics.compiled import jit

# A whole number in the lowest bits of a double: add, and look at the bits.
_SHIFT = 1.5 * 2.0**52
# Two or three parts of a constant: a whole number below 2^20 times the first ones is exact.
_HALF_PI = math.pi / 2
_HALF_PI_1, _HALF_PI_2, _HALF_PI_3 = (
    1.5707963267341256,
    6.077100506303966e-11,
    2.0222662487959506e-21,
)
_LN2_1, _LN2_2 = 0.6931471804855391, 7.440617110012407e-11
_LOG2_E, _TWO_OVER_PI = 1 / math.log(2), 2 / math.pi
# Bits of a double.
_MANTISSA, _ONE = (1 << 52) - 1, 1023 << 52
_TO_SQRT_HALF = _ONE - int(np.array(math.sqrt(0.5)).view(np.int64))
_WHOLE = 0x433 << 52  # 2^52, whose lowest bit is one
_LARGEST, _SMALLEST = 1.7976931348623157e308, 2.2250738585072014e-308
_TAN_EIGHTH_PI = math.tan(math.pi / 8)


def _bits(typing_context, x):
    def generate(context, builder, signature, values):
        return builder.bitcast(values[0], context.get_value_type(types.int64))

    return types.int64(types.float64), generate


def _double(typing_context, bits):
    def generate(context, builder, signature, values):
        return builder.bitcast(values[0], context.get_value_type(types.float64))

    return types.float64(types.int64), generate


_bits_of: Any = intrinsic(_bits)
_double_of: Any = intrinsic(_double)


_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract"},
    "_nrt": False,
}


def _function(function: Any) -> Any:
    """Compile without reordering; products may be fused into sums."""
    return jit(**_OPTIONS)(function)


@_function
def exponential(x):
    """exp(x); infinity above 709, zero below -708."""
    n = np.floor(x * _LOG2_E + 0.5)
    r = (x - n * _LN2_1) - n * _LN2_2
    s = r * r
    even = 1 + s * (
        1 / 2 + s * (1 / 24 + s * (1 / 720 + s * (1 / 40320 + s * (1 / 3628800 + s / 479001600))))
    )
    odd = 1 + s * (
        1 / 6
        + s * (1 / 120 + s * (1 / 5040 + s * (1 / 362880 + s * (1 / 39916800 + s / 6227020800))))
    )
    power = _double_of((_bits_of(n + _SHIFT) + 1023) << 52)
    value = (even + r * odd) * power
    value = np.inf if x > 709.0 else value
    return 0.0 if x < -708.0 else value


@_function
def sine_cosine(x):
    """Sine and cosine of x rad: accurate below 10^6, where the turns are taken off exactly."""
    n = np.floor(x * _TWO_OVER_PI + 0.5)
    r = ((x - n * _HALF_PI_1) - n * _HALF_PI_2) - n * _HALF_PI_3
    s = r * r
    sine = r + r * s * (
        -1 / 6
        + s
        * (
            1 / 120
            + s
            * (
                -1 / 5040
                + s * (1 / 362880 + s * (-1 / 39916800 + s * (1 / 6227020800 - s / 1307674368000)))
            )
        )
    )
    cosine = 1 + s * (
        -1 / 2
        + s
        * (
            1 / 24
            + s
            * (
                -1 / 720
                + s
                * (
                    1 / 40320
                    + s
                    * (
                        -1 / 3628800
                        + s * (1 / 479001600 + s * (-1 / 87178291200 + s / 20922789888000))
                    )
                )
            )
        )
    )
    quarter = _bits_of(n + _SHIFT)
    odd = (quarter & 1) != 0
    first, second = cosine if odd else sine, sine if odd else cosine
    first = -first if (quarter & 2) != 0 else first
    second = -second if ((quarter + 1) & 2) != 0 else second
    return first, second


@_function
def logarithm(x):
    """Natural logarithm; minus infinity at zero, not a number below."""
    shifted = _bits_of(x) + _TO_SQRT_HALF
    n = _double_of((shifted >> 52) | _WHOLE) - (2.0**52 + 1023)
    m = _double_of((shifted & _MANTISSA) + (_ONE - _TO_SQRT_HALF))
    f = (m - 1) / (m + 1)
    s = f * f
    tail = s * (
        1 / 3
        + s
        * (
            1 / 5
            + s
            * (
                1 / 7
                + s * (1 / 9 + s * (1 / 11 + s * (1 / 13 + s * (1 / 15 + s * (1 / 17 + s / 19)))))
            )
        )
    )
    value = n * _LN2_1 + (n * _LN2_2 + 2 * (f + f * tail))
    value = value if x > 0 else (-np.inf if x == 0 else np.nan)
    return x if x > _LARGEST else value


@_function
def angle(y, x):
    """Angle of x + jy in (-pi, pi]; 0 where both vanish."""
    a, b = abs(x), abs(y)
    steep = b > a
    small, large = a if steep else b, b if steep else a
    large += _SMALLEST
    near = small > _TAN_EIGHTH_PI * large
    t = (small - large if near else small) / (small + large if near else large)
    s = t * t
    tail = s * (
        -0.3333333333333333
        + s
        * (
            0.1999999999999552
            + s
            * (
                -0.14285714284666542
                + s
                * (
                    0.11111111015256361
                    + s
                    * (
                        -0.09090904578123903
                        + s
                        * (
                            0.07692183190826087
                            + s
                            * (
                                -0.06664511447381948
                                + s
                                * (
                                    0.0585814891280221
                                    + s
                                    * (
                                        -0.0508544973794026
                                        + s * (0.03923165829558719 - s * 0.01917688711906226)
                                    )
                                )
                            )
                        )
                    )
                )
            )
        )
    )
    turn = (math.pi / 4 if near else 0.0) + (t + t * tail)
    turn = _HALF_PI - turn if steep else turn
    turn = math.pi - turn if x < 0 else turn
    return -turn if y < 0 else turn
