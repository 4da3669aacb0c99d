"""Controllers in C: what one scene makes, beside C99 sources that are always the same.

May import everything below `softmpc.study`.
"""
