// Models of lenses, for C++, C and Python.
//
// Twin: rastercov.reference.lenses.
#pragma once
#include "lens/formulas.hpp"

namespace rastercov::lens {

// MODEL(name, base, names of its coefficients, in order; the numbers of them that may be given,
// the others being 0, where not all must be; and the parameters that they are).
#define RASTERCOV_MODELS(MODEL)                                                                    \
    MODEL(PINHOLE, PINHOLE, "", "")                                                                \
    MODEL(OPENCV, PINHOLE, "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y", "4 5 8 12 14", K1,   \
          K2, P1, P2, K3, D1, D2, D3, S1, S2, S3, S4, TAU_X, TAU_Y)                                \
    MODEL(OPENCV_FISHEYE, EQUIDISTANT, "k1 k2 k3 k4", "0 4", K1, K2, K3, K4)                       \
    MODEL(THIN_PRISM_FISHEYE, EQUIDISTANT, "k1 k2 p1 p2 k3 k4 s1 s3", "", K1, K2, P1, P2, K3, K4,  \
          S1, S3)                                                                                  \
    MODEL(RAD_TAN_THIN_PRISM_FISHEYE, EQUIDISTANT, "k1 k2 k3 k4 k5 k6 p2 p1 s1 s2 s3 s4", "", K1,  \
          K2, K3, K4, K5, K6, P2, P1, S1, S2, S3, S4)                                              \
    MODEL(FISHEYE62, EQUIDISTANT, "k1 k2 k3 k4 k5 k6 p1 p2 s1 s2 s3 s4", "8 12", K1, K2, K3, K4,   \
          K5, K6, P1, P2, S1, S2, S3, S4)                                                          \
    MODEL(FOV, FOV, "omega", "", OMEGA)                                                            \
    MODEL(DIVISION, DIVISION, "k", "", B0)                                                         \
    MODEL(OMNI, UNIFIED, "xi k1 k2 p1 p2", "1 5", B0, K1, K2, P1, P2)                              \
    MODEL(EUCM, UNIFIED, "alpha beta k1 k2 p1 p2", "2 6", B0, B2, K1, K2, P1, P2)                  \
    MODEL(DOUBLE_SPHERE, DOUBLE_SPHERE, "xi alpha k1 k2 p1 p2", "2 6", B0, B1, K1, K2, P1, P2)     \
    MODEL(METASHAPE, PINHOLE, "k1 k2 k3 k4 p1 p2", "", K1, K2, K3, K4, P2, P1)                     \
    MODEL(METASHAPE_FISHEYE, EQUIDISTANT, "k1 k2 k3 k4 p1 p2", "", K1, K2, K3, K4, P2, P1)         \
    MODEL(METASHAPE_EQUISOLID, EQUISOLID, "k1 k2 k3 k4 p1 p2", "", K1, K2, K3, K4, P2, P1)         \
    MODEL(EQUIRECTANGULAR, EQUIRECTANGULAR, "", "")
#define RASTERCOV_CODE_OF(name, ...) MODEL_##name,
enum ModelCode : int64_t { RASTERCOV_MODELS(RASTERCOV_CODE_OF) N_MODELS };
constexpr double LARGEST_COEFFICIENT = 1e12;

} // namespace rastercov::lens
