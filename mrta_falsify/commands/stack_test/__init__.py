"""``stack-test``: does a foreign stack keep to the protocol, and how fast is it?"""
