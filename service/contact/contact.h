// Contact of a rigid fingertip with one row of a tissue model in plane strain (T4.3 to T4.5b).
#pragma once

#include <cstddef>

#include "service/base/choices.h"
#include "service/contact/touch_model.h"
#include "service/tissue/compliance.h"
#include "service/tissue/tissue_problem.h"

namespace teletact::service {

// Pose in the plane: lateral position of the tip's centre and its indentation along +y, measured from the
// undeformed touched row (negative: not touching).
struct PlanePose {
  double x_m = 0;
  double indentation_m = 0;
};

// How the candidates of the unilateral contact are chosen; the answer does not depend on it.
struct ContactOptions {
  double candidate_margin = choices::kCandidateMargin;
};

// Solves the contact for one pose from one energy (T4.5), per metre of thickness:
//   U(pose) = max over p_y >= 0, p_x of  p^T w(pose) - 1/2 p^T (S + C(pose)) p + W(p_y, pose),
// S the row's compliance, W the tip's skin, which makes force and tangent smooth in the pose (fingertip.h).
// Frictionless: p_y alone, C = 0. Stuck: every overlapped node (w_i > 0) is tied to its place sideways by a
// spring of compliance C_i = 0.01 S_xx,ii (1 mm / w_i)^3 on the tangential diagonal: rigid to 1 % at 1 mm of
// overlap, vanishing with its first two derivatives as the overlap does, so that force and tangent have no
// jump where a node enters. Gaps w_i of node i at d = x_i - X (positive: overlap):
//   rounded tip  indentation - d^2 / (2 radius);   flat punch  indentation - max(0, |d| - half_width)^2 / (2
//   radius)
// Node: one constraint b^T u = indentation with weights b (hat function or Gaussian footprint), U =
// indentation^2 / (2 b^T S b); stuck: b^T u_x = 0 too. F = -dU/dpose by the envelope theorem; the tangent is
// the exact second derivative at the active set. All are multiplied by the model's thickness; along z force
// and tangent are zero. The largest strain is about 0.42 (1 + nu) p / E, p the mean pressure over the
// contact's effective width and E the modulus there, which is within a fifth of the finite-element field
// below tips of 4 to 16 mm (Hertz on a half plane gives 0.38); at least indentation over the tissue's depth
// below the row. Throws std::out_of_range when the tip overlaps the row beyond the columns the model can be
// touched on, std::invalid_argument (field named) for an unusable fingertip or pose, e.g. an indentation
// deeper than the tissue below the row, std::domain_error when no finite answer exists.
ContactAnswer solve_contact(const TissueProblem&, std::size_t row, Compliance&, const Fingertip&,
                            const PlanePose&, const ContactOptions& = {});

}  // namespace teletact::service
