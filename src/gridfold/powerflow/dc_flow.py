"""What a dc line draws at its ends."""

from __future__ import annotations

from dataclasses import dataclass

from gridfold.grid.dc_lines import DcLine


@dataclass(frozen=True)
class DcFlow:
    """Operating point of a dc line.

    Parameters
    ----------
    line : DcLine
        The line.
    power_mva : tuple of complex
        Power that each end draws from the ac network in MVA, in the order of ``line.buses``; without
        the reactive power of a converter that holds its bus's voltage.
    told : str
        What limits it; empty where nothing does.
    current_a : float
        Dc current in A.
    dc_kv : tuple of float
        Dc voltage of each end in kV.
    angles_deg : tuple of float
        Firing angle of the rectifier and extinction angle of the inverter; empty without thyristors.
    """

    line: DcLine
    power_mva: tuple[complex, complex]
    told: str = ""
    current_a: float = 0.0
    dc_kv: tuple[float, float] = (0.0, 0.0)
    angles_deg: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """The operating point, and how it is held in a run, in words."""
        ends = " and ".join(
            f"{power.real:.1f} MW {power.imag:+.1f} Mvar at bus {bus}"
            for bus, power in zip(self.line.buses, self.power_mva, strict=True)
        )
        angles = ", ".join(f"{angle:.1f} degrees" for angle in self.angles_deg)
        by_angles = f" (firing and extinction angle {angles})" if angles else ""
        limited = f"; {self.told}" if self.told else ""
        held = "current" if self.line.holds_current else "power"
        return (
            f"{self.line} draws {ends}, {self.current_a:.1f} A{by_angles}{limited}; in a run both ends "
            f"are constant {held}, and constant impedances below 0.7 p.u."
        )
