"""What leads the arm tick by tick: jogs, and targets that are dragged."""
