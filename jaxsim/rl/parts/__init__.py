"""What trainers are made of: experience, advantages, steps of descent, several devices."""
