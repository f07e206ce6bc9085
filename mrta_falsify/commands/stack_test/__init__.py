"""``stack-test``: does a stack in a process of its own keep to the protocol, and how fast is it?"""
