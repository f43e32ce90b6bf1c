"""A course of four exercises with gaps: files to fill in, and checks that say what is right and what is not yet."""
