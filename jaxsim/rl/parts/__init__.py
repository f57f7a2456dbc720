"""Parts of trainers: experience, advantages, gradient descent, several devices."""
