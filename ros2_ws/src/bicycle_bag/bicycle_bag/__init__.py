"""MCAP bags as rosbag2 writes them: record, replay, read, repair."""
