"""The map itself: occupied and free cells, pieces of walls, walls as lines, and the way of each robot in it."""
