// A block of solid tissue behind the seam (touch_model.h): its surface and the rows of nodes below it,
// touched in three dimensions.
#pragma once

#include <chrono>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "service/contact/touch_model.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

class SolidNodes;

// The block, and where it lies in the scene. What surrounds `region` is context, and the period's seam.
struct SolidBlock {
  SolidTissue tissue;
  double origin_x_m = 0, origin_z_m = 0;  // of its node (0, 0)
  Region region;                          // where it can be touched
  // Standard deviation of ln E, the least of what the slices state; 0: they are exact, or none was given.
  double log_deviation = 0;
};

// A row of nodes of a solid.
struct SolidRowState {
  std::shared_ptr<Device> device;
  std::weak_ptr<SolidNodes> ready;   // on that device
  std::shared_ptr<SolidNodes> kept;  // the same
  bool asked = false;
  std::exception_ptr error;
  std::chrono::steady_clock::time_point retry{};
};

// A block and its layers: shared with the work that makes them ready, which may outlive the model, and with
// the models that take its place.
struct SolidState {
  SolidBlock block;
  MemoryAccount account;
  Charge charge;
  mutable std::mutex mutex;  // held for looking things up only
  std::map<std::size_t, SolidRowState> rows{{0, {}}};
  std::shared_ptr<SolidState> before;  // whose surface is being made ready, until this one's is
};

// It answers by conjugate gradients on the device of whoever touches it. Its surface is kept once it is
// ready, and what all layers are solved with; of those below the one that was made last, and the others while
// they are touched.
class SolidTouchModel final : public TouchModel {
 public:
  // A layer that could not be made is tried again after this long; until then asking for it says why.
  static constexpr std::chrono::seconds kRetry{1};

  // `before`: of the model of the same grid whose place it takes: what that solves with is used again. This
  // one is ready at once where that is, else once that is, if it is being made ready.
  SolidTouchModel(SolidBlock, MemoryAccount account, const std::shared_ptr<SolidState>& before = nullptr);
  Region region() const override { return state_->block.region; }
  std::vector<Layer> layers() const override;  // every row of nodes that is not held
  std::string plan() const override;
  // The same tissue with a factor of its own layers.
  std::shared_ptr<const TouchModel> renewed(const MemoryAccount&) const override;
  std::shared_ptr<TouchedLayer> layer(const Layer&, const TouchWay&, const TouchWork& work) const override;

 private:
  using State = SolidState;
  using Row = SolidRowState;
  using Make = std::function<std::shared_ptr<SolidNodes>(const State&)>;
  std::shared_ptr<SolidNodes> surface(const TouchWay&, const TouchWork&) const;
  // The row; null while it is being made, which this asks `work` for.
  std::shared_ptr<SolidNodes> row(std::size_t, const TouchWay&, const TouchWork&, const Make&) const;
  static void make_ready(State&, std::size_t row, const std::shared_ptr<Device>&, const Make&);
  // The surface that is ready, and on which device; null: none.
  static std::pair<std::shared_ptr<SolidNodes>, std::shared_ptr<Device>> ready(const State&);
  std::shared_ptr<State> being_made_before() const;
  // Ready with what `before` solves with, if that is ready on this device (null: on any).
  static bool take_over(State&, const State& before, const std::shared_ptr<Device>&);
  const std::shared_ptr<State> state_;
};

// Compiles what touch and imaging of solids use of the device. Fourier transforms are compiled for each pair
// of sizes: those of usual scenes, and of usual probes.
void warm_solids(const std::shared_ptr<Device>&);

}  // namespace teletact::service
