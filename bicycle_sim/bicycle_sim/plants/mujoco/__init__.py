"""The same bicycles in MuJoCo, an engine that nobody here wrote: a second opinion."""
