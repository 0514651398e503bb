"""Dynamic models: devices, network, start values, right-hand side and Jacobian."""
