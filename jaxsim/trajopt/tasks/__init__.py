"""Tasks that show what plans are good for; `jaxsim optimize` solves and films them."""

from jaxsim.trajopt.tasks import contacts, moving, objects, swing_up
from jaxsim.trajopt.tasks.task import Task, model_of

TASKS: dict[str, Task] = swing_up.TASKS | moving.TASKS | objects.TASKS | contacts.TASKS

__all__ = ["TASKS", "Task", "model_of"]
