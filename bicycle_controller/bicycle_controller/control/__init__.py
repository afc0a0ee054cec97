"""Control of a bicycle, from state to command; never imports torch."""
