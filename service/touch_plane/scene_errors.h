// What a scene adds to what the model of a touch says that it may be off by: how well its modulus is known,
// tissue that nobody gave, and what measured tissue rests on.
#pragma once

#include <cmath>
#include <optional>

#include "service/contact/touch_model.h"
#include "service/scene/scene.h"
#include "service/scene/slices.h"

namespace teletact::service {

// Of a tip that stands above it, a light touch's.
FeltPlace felt_by(const Fingertip&, const Layer&, const TouchPose&);

struct SceneErrors {
  // Standard deviation of ln E of what is felt there: of a solid's slices; of a plane the median over its
  // window (where it states none that of tissue nobody measured, and what the window's places share). Nothing
  // where the modulus was given.
  std::optional<FeltDeviation> log_deviation;
  // The nearest end of a solid that was given, and what the force changes by, over itself, where all beyond
  // it is three times as stiff or as soft: the share of the force that is borne there (T9.6) times ln 3.
  double end_away_m = HUGE_VAL, beyond_end = 0;
  // Share of the force of measured tissue, 0 of other: nobody knows whether it slides. A soft bed is not in
  // it.
  double lost_by_sliding = 0;
  double stiffening = 0;  // ForceBudget::above

  // To the budget of an answer that has one, which that of a round tip has.
  void add_to(ContactAnswer&) const;
};

SceneErrors scene_errors(const Scene&, const SceneSnapshot&, const WindowModel&, const Fingertip&,
                         const Layer&, const TouchPose&);

}  // namespace teletact::service
