"""viewer: the robot in the browser, and targets dragged there."""
