"""Mathematics only: compiled callbacks, Newton, steppers."""
