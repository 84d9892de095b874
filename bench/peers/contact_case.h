// The contact problems that the chart measures on: tissue of a stated size, contrast and pattern, a rounded
// tip that touches a stated number of nodes, and the answer of the double reference (T4.1).
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "service/contact/contact.h"
#include "tests/reference/contact.h"

namespace teletact::bench {

enum class Pattern {
  kNodule,        // a stiff disc in soft tissue
  kCheckerboard,  // squares of 5 mm
  kSponge,        // soft round pores in stiff tissue
  kLayered,       // six horizontal layers, soft on top
};
const char* to_string(Pattern);

// 60 mm wide, bottom fixed, elements of equal size.
struct ContactCase {
  std::size_t columns = 61, rows = 61;  // of nodes
  double poisson_ratio = 0.49;
  double contrast = 10;  // stiffest element over softest (10 kPa); each pattern has both
  Pattern pattern = Pattern::kNodule;
  double stretch = 1;              // height of an element over its width
  std::size_t contact_nodes = 16;  // that the tip touches
};
// "61x61 nu 0.49 contrast 10 nodule", with " stretch 5" where it is not 1.
std::string describe(const ContactCase&);

reference::TouchedTissue make_tissue(const ContactCase&);

struct ContactProblem {
  ContactCase of;
  reference::TouchedTissue tissue;
  service::Fingertip tip;
  service::PlanePose pose;
  Eigen::SparseMatrix<double> stiffness;  // of every degree of freedom, supported ones as the identity
  std::vector<std::size_t> contact_dofs;  // axial degrees of freedom of the nodes in contact
  // Of each node in contact: its axial displacement in the reference's answer, and the slope of the tip
  // there.
  Eigen::VectorXd overlap_m, slope;
  double axial_share = 1;  // of the sum of the nodal forces in the axial force: the skin bears the rest
  reference::ContactSolution truth;

  // On the finger, from the multipliers of the nodes in contact (N/m, < 0 pushes the tissue).
  std::array<double, 2> force_n(const Eigen::VectorXd& multiplier_n_m) const;
  // Distance of a force from the reference's over the size of that; NaN stays NaN.
  double force_error(const std::array<double, 2>& force_n) const;
  // Largest error over the largest displacement.
  double displacement_error(const Eigen::VectorXd& displacement_m) const;
};

// The tip's radius is chosen so that, pressed by 1 mm beside the middle, it touches `contact_nodes` nodes.
// Throws std::invalid_argument when no radius does.
ContactProblem make_problem(const ContactCase&);

}  // namespace teletact::bench
