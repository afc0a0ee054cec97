"""Tools around a ride: goals, reports, pictures, verification, and a bridge to Foxglove."""
