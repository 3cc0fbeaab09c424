"""A listening test: can anybody hear the difference between an Object File and its truth?"""
