"""Recordings of messages: MCAP and bags of ROS; one topic is one table."""
