"""A hand that does random things in the real window: begin in `driver`."""
