"""Does `explain` name the layer of a fault that was planted, and none where there is none?"""
