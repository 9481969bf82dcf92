// Faces of a mesh in contact with another one: those that touch or cut it.
//
// Conservative: a false positive costs time, a false negative would break a certificate. A tree of
// boxes finds the pairs, separating axes decide each; see mesh/contacts.hpp.
//
// Twin: tests/mesh/test_contacts.py compares all pairs.
#pragma once
#include "solver/build.hpp"
#include <atomic>

namespace rastercov::engine {

// Contact distance in diagonals of the bounding box, for cameras within REACH of them; ten times
// that for each further decade.
constexpr double CONTACT = 1e-8;

// Margin of boxes of float in a scene of diagonal 1 about the origin: twice the rounding of 1/2.
constexpr double BOX_MARGIN = 0x1p-24;
constexpr double ROUNDING_FACTOR = 1.01; // on a tolerance, for the rounding of a distance
constexpr int64_t PAIRS_A_FACE = 8;      // in contact, beyond which none is listed
constexpr int64_t MOST_PARTNERS = 24;    // of a face, beyond which they are not listed

struct ContactOptions {
    int64_t n_threads = 1;
    int64_t most_at_corner = 256; // faces beyond which they are compared by their directions
    int64_t leaves_a_part = 128;  // leaves of the tree that a thread takes at a time
    std::atomic<int64_t> *n_steps = nullptr; // out: steps through the trees, and pairs
};

// Faces of a mesh that are not `is_flat`, (F,), and come within `tolerance`, metres, of another
// one, except where the two are joined; with `labels`, (F,) or none, only of one of the same label.
Room<bool> find_touching(const Welded &mesh, BoolArray is_flat, Int32Array labels, double tolerance,
                         const ContactOptions &options = {});

// The same faces, `touching`, and with which others each of them is in contact.
Contacts find_partners(const Welded &mesh, Room<bool> touching, double tolerance,
                       const ContactOptions &options = {});

// The way to contacts of a mesh, which keeps alive what `owner` holds.
ContactFinder finder_of(const Welded &mesh, BoolArray is_flat, double diagonal, Owner owner,
                        int64_t n_threads);

} // namespace rastercov::engine
