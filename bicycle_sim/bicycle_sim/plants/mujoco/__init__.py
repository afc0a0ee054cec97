"""The measured bicycles in MuJoCo, an independent engine, as a second opinion."""
