"""Many runs of one grid side by side: members of a batch are columns of its arrays."""
