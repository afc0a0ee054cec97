"""A simulated bicycle whose sensors and motors hang on the simulated board."""
