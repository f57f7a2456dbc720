"""What pushes: actuators, springs, dampers, fluid, gravity compensation, applied wrenches."""
