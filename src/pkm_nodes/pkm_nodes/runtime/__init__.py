"""What every node runs on: node base class, lock-step executor and queues."""
