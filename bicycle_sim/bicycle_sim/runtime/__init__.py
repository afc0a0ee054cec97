"""One bicycle in time: simulator, loop, pacing, and what is let in."""
