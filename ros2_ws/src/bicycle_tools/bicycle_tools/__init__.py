"""Tools around a ride: goals, reports, pictures, proofs, and a bridge to Foxglove."""
