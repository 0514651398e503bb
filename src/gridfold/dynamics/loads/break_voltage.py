"""The voltage below which every load is a constant impedance, as usual in stability programs."""

#: In p.u.; PQBRAK of PSS/E.
BREAK_VOLTAGE = 0.7
