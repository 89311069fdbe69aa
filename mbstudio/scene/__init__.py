"""pyvista scenes on any plotter; no Qt. The same code draws the window and the figures."""
