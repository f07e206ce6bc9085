"""Automatic mutants of the stack: which of them can be killed, and which does a search kill?"""
