"""Forces of the medium: drag, lift and added mass of boxes and ellipsoids."""
