"""First and second derivatives of what jaxfric computes, against differences."""
