"""Controllers in C: data and model functions of one scene beside C99 sources that are always the same.

May import everything below `softmpc.study`.
"""
