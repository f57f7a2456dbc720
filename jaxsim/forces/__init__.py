"""Forces: actuators, springs, dampers, fluid, gravity compensation and applied wrenches."""
