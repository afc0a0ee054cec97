"""The Whipple-Carvallo bicycle: nonlinear, batched, compiled, and to the bit the same anywhere."""
