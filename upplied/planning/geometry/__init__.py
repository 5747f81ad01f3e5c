"""Curves and boxes: Frechet distance, ICP, bounding boxes. Knows records alone."""
