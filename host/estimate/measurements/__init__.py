"""What the estimator listens to, one measurement a file: its model, its noise and its gate. Every
innovation is kept for the record (`host.estimate.kalman.Innovation`)."""
