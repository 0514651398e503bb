"""Many runs of one grid on a GPU: a block of threads for each run, a thread for each unit."""
