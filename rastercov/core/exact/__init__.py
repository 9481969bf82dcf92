r"""Exact visibility: surfaces and cameras as the engine in `rastercov/engine/solver` takes them.

In the image 1/z is affine on a face, so the part of face T that face M hides is the convex polygon
T n M n {1/z_M > 1/z_T}, and

    visible(T) = T \ U_M T n M n {1/z_M > 1/z_T}.

No depth sorting is needed: faces that overlap cyclically or pierce one another are correct. Most
faces need no such work: seen from a camera, the set of surfaces before a point changes only across
event edges, silhouettes and borders. A face that no visible part of an event edge crosses, and that
no other face touches, is wholly visible or wholly hidden, and so are all faces joined to it: a
region, which its largest face decides.

A. Appel. The Notion of Quantitative Invisibility and the Machine Rendering of Solids. 1967.
"""
