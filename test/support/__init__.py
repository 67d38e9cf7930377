"""Help for the tests: slow obvious twins, hypothesis strategies, grids as ASCII pictures.

Nothing in the package imports this folder. `strategies` needs hypothesis, `ros` needs rclpy.
"""
