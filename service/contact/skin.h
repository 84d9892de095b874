// The skin of a punch or a rounded tip: a thin layer that spreads the moment at which a node begins to touch,
// so that force and tangent are smooth in the pose (T4.5b). A rigid tip meets the nodes one by one, and its
// tangent jumps by some percent at each.
//
// A node that bears p (N/m) keeps the gap g = t (s - kSkinMiddle) from the tip, where s in (0, 1] solves
//   p = b t (1 - s)^2 / s,   b = kSkinStiffness / S_ii:
// p rises from 0 at s = 1 with its slope, and s falls to 0 as p grows. t is the thickness of the skin: what
// the tip rises by between the outermost node in contact and the next, about. It shrinks with the mesh and
// vanishes with the indentation. The middle is chosen so that the force is, in the mean, the rigid tip's.
// W(p, t) = Int_0^p g dp is the skin's part of the energy that the contact maximises (touch.h).
#pragma once

#include "service/contact/contact.h"

namespace teletact::service {

constexpr double kSkinStiffness = 0.1;
constexpr double kSkinMiddle = 0.12;

// Of one node, and its derivatives by the indentation: t = d h / (h + a), h the node's width, a half of the
// undeformed overlap.
struct SkinThickness {
  double t_m = 0, slope = 0, curvature_1_m = 0;
};
SkinThickness skin_thickness(const Fingertip&, double indentation_m, double width_m);

struct SkinState {
  double s = 1, rest = 0;  // rest = 1 - s
  double gap_m = 0;
  double compliance = 0;  // -dg/dp, m per N/m; infinite at p = 0
  double gap_by_t = 0;    // dg/dt at constant p
};
// `stiffness`: b. p >= 0.
SkinState skin_state(double p, double stiffness, double thickness_m);

struct SkinEnergy {
  double w = 0, by_t = 0, by_t2 = 0;  // W and its derivatives by t at constant p
};
SkinEnergy skin_energy(const SkinState&, double p, double stiffness, double thickness_m);

}  // namespace teletact::service
