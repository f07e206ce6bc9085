"""Does the search find what is there to be found?"""
