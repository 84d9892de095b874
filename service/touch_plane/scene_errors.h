// What a scene adds to what the model of a touch says that it may be off by: how well its modulus is known,
// and tissue that nobody gave.
#pragma once

#include <cmath>
#include <optional>

#include "service/contact/touch_model.h"
#include "service/scene/scene.h"

namespace teletact::service {

// Standard deviation of ln E of what is felt there: of a solid's slices; of a plane the median over its
// window (of tissue nobody measured, where it states none) with the force sensor's and the contact area's.
// Nothing where the modulus was given.
std::optional<double> stated_log_deviation(const SceneSnapshot&, const WindowModel&, const Layer&,
                                           const TouchPose&);

// The nearest end of a solid that was given, and what the force changes by, over itself, where all beyond it
// is three times as stiff or as soft: the share of the force that is borne there (T9.6) times ln 3.
struct Beside {
  double away_m = HUGE_VAL, share = 0;
};
Beside beside_what_was_given(const Region&, const Fingertip&, const TouchPose&, double depth_m);

// To the budget of an answer that has one.
void add_scene_errors(const std::optional<double>& log_deviation, const Beside&, ContactAnswer&);

}  // namespace teletact::service
