// Contact of a rigid fingertip with one line of a tissue model (T4.3 to T4.5b).
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "service/tissue/compliance.h"
#include "service/tissue/tissue_model.h"

namespace teletact::service {

enum class FingertipShape { kNode, kFlatPunch, kRoundedTip };
enum class Friction { kFrictionless, kStuck };

struct Fingertip {
  FingertipShape shape = FingertipShape::kRoundedTip;
  Friction friction = Friction::kFrictionless;
  double radius_m = 0.008;      // rounded tip: radius of curvature; flat punch: radius of its edges
  double half_width_m = 0.004;  // flat punch only: half of the flat part
  double footprint_m = 0;       // node only: standard deviation of a Gaussian footprint, 0 = the hat function
};

// Pose in scene or model coordinates: lateral position of the tip's centre and its indentation along +y,
// measured from the undeformed touched line (negative: not touching).
struct ContactPose {
  double x_m = 0;
  double indentation_m = 0;
};

struct NodalPressure {
  double x_m = 0;          // undeformed position of the node on the line
  double pressure_pa = 0;  // >= 0 pushes into the tissue
  double traction_pa = 0;  // tangential (stuck)
};

enum class ContactState { kNoContact, kContact };

// What the client gets (T4.5). force_n acts on the finger: F = -dU/dpose, so force_n[1] <= 0 for a push along
// +y. tangent_n_m = dF/dpose (2x2, symmetric, row-major; d force_y/d indentation <= 0).
struct ContactAnswer {
  ContactState state = ContactState::kNoContact;
  std::array<double, 2> force_n{};
  std::array<double, 4> tangent_n_m{};
  double energy_j = 0;                  // U(pose)
  std::vector<NodalPressure> pressure;  // active nodes only
  double largest_strain = 0;            // indentation over contact size or depth, what T4.5 flags above 0.15
  bool strain_beyond_linear = false;    // largest_strain > 0.15
  std::size_t active_set_changes = 0;
  SolveReport solve;
};

// Solves the unilateral contact for one pose: U = min over p_y >= 0 of the complementary energy on the nodes
// of the patch. Throws std::out_of_range when the tip reaches beyond the columns the model can be touched on,
// std::invalid_argument (field named) for an unusable fingertip or pose, e.g. an indentation deeper than the
// tissue below the line.
ContactAnswer solve_contact(const TissueModel&, std::size_t line, Compliance&, const Fingertip&,
                            const ContactPose&);

}  // namespace teletact::service
