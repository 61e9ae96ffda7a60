"""What a user waits for, seen from outside: a board that stamps what comes, and pages without a browser."""
