"""Between the topics and a microcontroller: frames, the serial line, a simulated board."""
