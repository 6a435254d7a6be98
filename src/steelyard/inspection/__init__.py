"""What is in a recording before anything is made of it: its streams, what they say of each other,
and the mistakes that this gives away.
"""
