"""What drives a bicycle from state to command; never torch."""
