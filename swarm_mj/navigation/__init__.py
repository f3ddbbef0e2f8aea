"""Navigation by pictures: what a picture of the body tells of where the camera is, and the filter that keeps it."""
