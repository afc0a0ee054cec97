"""MCAP bags as rosbag2 writes them: record, replay, read, repair."""

__version__ = "0.1.0"
