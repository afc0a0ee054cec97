"""The paper's bicycle: Table 1, equations 1 to 13, and their linear model."""
