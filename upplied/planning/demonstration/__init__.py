"""What the expert flew and inspected: denoised flight, viewpoints, repetitions."""
