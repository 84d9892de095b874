// How the modulus of a pair is found where its client names no method: the cheapest that is good enough for
// the force, of those that the time leaves (T3.8).
#pragma once

#include <array>
#include <optional>
#include <string>

#include "service/imaging/modulus/modulus.h"

namespace teletact::service {

// Accuracy that a force asks of the modulus that it is made from.
struct ModulusNeed {
  double tolerance = 0.03;  // over the force (T9.5)
  double common = 0;        // standard deviation of log E that no method changes: force sensor, contact area
};

struct ModulusTime {
  std::optional<double> left_s{};      // s of work, none: nobody waits
  std::string words{};                 // whose time that is, for people: "0.5 s by finish_within_s"
  std::array<double, 4> expected_s{};  // by ModulusKind
};

// The modulus as reference stress shows it, uncorrected: by how much the mean of log E over a square of 10 mm
// that a finger on the surface feels is off the background's, at most, to the stiff side and to the soft; not
// a number where no square has half of its nodes.
struct Unevenness {
  double stiff = 0, soft = 0;
};
Unevenness unevenness(const Field& youngs_modulus, double background, const ImageGrid&);

// Median over the trusted nodes of the axial strain's deviation over the strain; not a number without any.
double noise_of(const Measured&);

// Error of log E by reference stress and by the iterative method, at 95 % of the places that a finger feels;
// infinite where there is more noise than that is known for, and where nothing was measured.
double expected_error(ModulusKind, const Unevenness&, double noise);

struct ModulusPlan {
  ModulusKind kind = ModulusKind::kIterative;
  double tolerance = 0.03;  // that the modulus may take: where an iteration's steps change less, it is over
  std::string why{};        // one sentence for people
};
// Reference stress where its error is known to be within the need: the tolerance, or half of what is common,
// up to 10 %; else the iterative method, which stops in time, with what the direct one found at worst. Where
// the time does not do for that, reference stress.
ModulusPlan plan_modulus(const ModulusNeed&, double noise, const Unevenness&, const ModulusTime&);

}  // namespace teletact::service
