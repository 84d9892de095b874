// Which models scenes are touched on. What chooses them is here alone: a scene asks, and knows no model.
#pragma once

#include <memory>
#include <vector>

#include "service/base/memory.h"
#include "service/contact/touch_model.h"
#include "service/scene/geometry.h"
#include "service/scene/scene_record.h"
#include "service/scene/stitched_map.h"

namespace teletact::service {

// What a model is wanted of: the tissue around a window of a scene.
struct WantedModel {
  const SceneGeometry& geometry;
  const StitchedMap& map;
  Region region;                       // where the finger will be
  std::vector<Layer> in_use;           // layers that are touched: ready when the model is
  const TouchModel* before = nullptr;  // the model whose place it takes; may be null
  MemoryAccount account = {};          // in whose name it is held
};

class TouchModels {
 public:
  virtual ~TouchModels() = default;
  // The layers of every model of such a scene's windows, by depth.
  virtual std::vector<Layer> layers(const SceneGeometry&) const = 0;
  // How far a window's model reaches into the tissue beside it: those this near are stale when a window
  // changes.
  virtual double context_m() const = 0;
  // Throws std::invalid_argument (field named) for a touch that no model of such tissue answers: its stream
  // is refused when it opens.
  virtual void check(bool /*solid*/, const Fingertip&, const Layer&, const TouchWay&) const {}
  // Both throw std::invalid_argument (field named) and MemoryRefused: the caller is told so. A scene that was
  // kept and is refused at the start stays on disk until it is taken.
  virtual std::shared_ptr<const TouchModel> of_window(const WantedModel&) const = 0;
  // Of the whole tissue, whose modulus is given, on exactly this grid.
  virtual std::shared_ptr<const TouchModel> of_modulus(const SceneGeometry&, const ExplicitModulus&,
                                                       const MemoryAccount&) const = 0;
  // Of a solid whose model `before` was one slice less, or had another in this one's place (none: any of
  // them may be another one): soon.
  virtual std::shared_ptr<const TouchModel> of_slice(const SceneGeometry& geometry, const ExplicitModulus& e,
                                                     std::optional<std::size_t> /*slice*/,
                                                     const TouchModel& /*before*/,
                                                     const MemoryAccount& account) const {
    return of_modulus(geometry, e, account);
  }
  // Compiles what they use of the device: the first touch must not wait for the compiler.
  virtual void warm(const std::shared_ptr<Device>&) const {}
};

// Plane strain around a window (tissue_models.h), and given grids as they are: planes, or solids.
std::shared_ptr<const TouchModels> tissue_models();

}  // namespace teletact::service
