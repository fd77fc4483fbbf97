"""Base of every node: node class, lock-step executor, queues, and the fallback to rclpy's public API."""
