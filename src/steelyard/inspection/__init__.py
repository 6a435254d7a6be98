"""What is in a recording before anything is estimated: its streams, and what each shows by itself;
``agreements``, then ``mistakes``, contacts, delays and the information of all readings;
imports experiments, instruments and identification.
"""
