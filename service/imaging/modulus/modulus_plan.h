// How the modulus of a pair is found where its client names no method: the cheapest that is good enough for
// the force, of those that there is time for (T3.8).
#pragma once

#include <string>

#include "service/imaging/modulus/modulus.h"

namespace teletact::service {

// Accuracy that a force asks of the modulus that it is made from.
struct ModulusNeed {
  double tolerance = 0.03;  // over the force (T9.5)
  double common = 0;        // standard deviation of log E that no method changes: force sensor, contact area
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

// Seconds of the parts of a modulus.
struct ModulusCost {
  double reference_s = 0, direct_s = 0;
  double step_s = 0;   // of the iterative method, after the direct one
  double solve_s = 0;  // of a solid's forward model

  // What there is time for in `left_s`; `why` says for people whose time that is.
  ModulusBudget within(double left_s, const std::string& why) const;
};

struct ModulusPlan {
  ModulusKind kind = ModulusKind::kIterative;
  double tolerance = 0.03;  // that the modulus may take: where an iteration's steps change less, it is over
  std::string why{};        // one sentence for people
};
// Reference stress where its error is known to be within the need: the tolerance, or half of what is common,
// up to 10 %; else the iterative method, with as many steps as the budget has. Where that has no start for
// it, reference stress.
ModulusPlan plan_modulus(const ModulusNeed&, double noise, const Unevenness&, const ModulusBudget&);

}  // namespace teletact::service
