"""Path planning on costmaps, shared by all robots and by the humans."""
