"""Text of the kernel that finds the voltages from the currents of a run, in one of two ways.

The text reads the currents of the terminals from ``shared[:n]`` and ``shared[n:2 * n]``, and the
compensating currents of the network state from ``shared[compensating:]``; both are complete. It writes
the voltages of the terminals into ``signals``.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NetworkText:
    """How a kernel solves the network.

    Parameters
    ----------
    arguments : tuple of str
        Arrays that it takes for that.
    begin : str
        What is done once at the start of a run.
    solve : str
        From currents to voltages at the terminals.
    bus : str
        The voltage ``v_r, v_i`` of the energized bus ``b`` after that.
    """

    arguments: tuple[str, ...]
    begin: str
    solve: str
    bus: str


def full_network(in_shared: bool) -> NetworkText:
    """Matrices of impedances; those between terminals in shared memory or not."""
    return NetworkText(
        ("impedance", "bus_impedance", "caused", "bus_caused"),
        _FULL_IN_SHARED if in_shared else "impedances = impedance\n",
        _FULL,
        _FULL_BUS,
    )


def sparse_network(in_shared: bool) -> NetworkText:
    """Sparse factors taken level by level (:mod:`gridfold.dynamics.cuda.levels`).

    The compensating currents go into the network as currents at their buses, so that it is solved for
    all buses at once. The vector of the rows is in shared memory or not.
    """
    return NetworkText(
        (
            "levels_at", "low_at", "low_columns", "low_values", "up_at", "up_columns", "up_values",
            "inverse_diagonal", "tail_inverse", "inputs_at", "inputs_of", "terminal_rows", "bus_rows",
            "change_rows", "vectors",
        ),
        _SPARSE_BEGIN + ("v = shared[room:]\n" if in_shared else "v = vectors[run]\n"),
        _SPARSE,
        "v_r, v_i = v[bus_rows[b]], v[m + bus_rows[b]]\n",
    )  # fmt: skip


_FULL_IN_SHARED = """\
impedances = shared[room:]
for k in range(tid, 2 * n * n, size):
    impedances[k] = impedance[k]
"""

_FULL = """\
for t in range(tid, n, size):
    v_r, v_i = zero, zero
    for k in range(n):
        z_r, z_i = impedances[k * n + t], impedances[(n + k) * n + t]
        v_r += z_r * shared[k] - z_i * shared[n + k]
        v_i += z_r * shared[n + k] + z_i * shared[k]
    for r in range(rank):
        z_r, z_i = caused[network, 0, r, t], caused[network, 1, r, t]
        j_r, j_i = shared[compensating + r], shared[compensating + most + r]
        v_r += z_r * j_r - z_i * j_i
        v_i += z_r * j_i + z_i * j_r
    signals[voltages + t], signals[voltages + n + t] = v_r, v_i
"""

_FULL_BUS = """\
v_r, v_i = zero, zero
for k in range(n):
    z_r, z_i = bus_impedance[0, k, b], bus_impedance[1, k, b]
    v_r += z_r * shared[k] - z_i * shared[n + k]
    v_i += z_r * shared[n + k] + z_i * shared[k]
for r in range(rank):
    z_r, z_i = bus_caused[network, 0, r, b], bus_caused[network, 1, r, b]
    j_r, j_i = shared[compensating + r], shared[compensating + most + r]
    v_r += z_r * j_r - z_i * j_i
    v_i += z_r * j_i + z_i * j_r
"""

# Rows of the vector: all rows by level, the tail last; behind them room for the tail once more.
_SPARSE_BEGIN = """\
n_levels, n_rows, n_tail = len(levels_at) - 1, len(low_at) - 1, tail_inverse.shape[1]
first_tail, m = n_rows - n_tail, n_rows + n_tail
"""

_SPARSE = """\
for k in range(tid, n_rows, size):
    b_r, b_i = zero, zero
    for e in range(inputs_at[k], inputs_at[k + 1]):
        b_r += shared[inputs_of[e]]
        b_i += shared[n + inputs_of[e]]
    v[k], v[m + k] = b_r, b_i
cuda.syncthreads()
for r in range(tid, rank, size):
    v[change_rows[network, r]] += shared[compensating + r]
    v[m + change_rows[network, r]] += shared[compensating + most + r]
cuda.syncthreads()
for level in range(1, n_levels):
    for k in range(levels_at[level] + tid, levels_at[level + 1], size):
        b_r, b_i = v[k], v[m + k]
        for e in range(low_at[k], low_at[k + 1]):
            a_r, a_i, c = low_values[0, e], low_values[1, e], low_columns[e]
            b_r -= a_r * v[c] - a_i * v[m + c]
            b_i -= a_r * v[m + c] + a_i * v[c]
        v[k], v[m + k] = b_r, b_i
    cuda.syncthreads()
for k in range(first_tail + tid, n_rows, size):
    b_r, b_i = v[k], v[m + k]
    for e in range(low_at[k], low_at[k + 1]):
        a_r, a_i, c = low_values[0, e], low_values[1, e], low_columns[e]
        b_r -= a_r * v[c] - a_i * v[m + c]
        b_i -= a_r * v[m + c] + a_i * v[c]
    v[n_tail + k], v[m + n_tail + k] = b_r, b_i
cuda.syncthreads()
for k in range(tid, n_tail, size):
    b_r, b_i = zero, zero
    for c in range(n_tail):
        a_r, a_i = tail_inverse[0, c, k], tail_inverse[1, c, k]
        b_r += a_r * v[n_rows + c] - a_i * v[m + n_rows + c]
        b_i += a_r * v[m + n_rows + c] + a_i * v[n_rows + c]
    v[first_tail + k], v[m + first_tail + k] = b_r, b_i
cuda.syncthreads()
for above in range(n_levels):
    level = n_levels - 1 - above
    for k in range(levels_at[level] + tid, levels_at[level + 1], size):
        b_r, b_i = v[k], v[m + k]
        for e in range(up_at[k], up_at[k + 1]):
            a_r, a_i, c = up_values[0, e], up_values[1, e], up_columns[e]
            b_r -= a_r * v[c] - a_i * v[m + c]
            b_i -= a_r * v[m + c] + a_i * v[c]
        a_r, a_i = inverse_diagonal[0, k], inverse_diagonal[1, k]
        v[k], v[m + k] = a_r * b_r - a_i * b_i, a_r * b_i + a_i * b_r
    cuda.syncthreads()
for t in range(tid, n, size):
    k = terminal_rows[t]
    signals[voltages + t] = v[k] if k >= 0 else zero
    signals[voltages + n + t] = v[m + k] if k >= 0 else zero
"""
