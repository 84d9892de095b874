// A block of solid tissue behind the seam (touch_model.h): its surface, in three dimensions.
#pragma once

#include <chrono>
#include <exception>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "service/contact/touch_model.h"
#include "service/solid/solid_tissue.h"

namespace teletact::service {

// The block, and where it lies in the scene. What surrounds `region` is context, and the period's seam.
struct SolidBlock {
  SolidTissue tissue;
  double origin_x_m = 0, origin_z_m = 0;  // of its node (0, 0)
  Region region;                          // where it can be touched
};

// It answers by conjugate gradients on the device of whoever touches it, so it has no contact law yet.
class SolidTouchModel final : public TouchModel {
 public:
  // A layer that could not be made is tried again after this long; until then asking for it says why.
  static constexpr std::chrono::seconds kRetry{1};

  // `before`: a model of the same grid whose place it takes: what that solves with is used again. This one is
  // ready at once where that is, else once that is, if it is being made ready.
  SolidTouchModel(SolidBlock, MemoryAccount account, const SolidTouchModel* before = nullptr);
  const SolidBlock& block() const { return state_->block; }
  // The shape of SolidContact::drift(); 0 until it is ready.
  double drift() const;
  // The same tissue with a factor of its own layers, ready on the same device.
  std::shared_ptr<const SolidTouchModel> renewed(const MemoryAccount&) const;
  const char* name() const override { return "solid"; }
  Region region() const override { return state_->block.region; }
  std::vector<Layer> layers() const override { return {Layer{}}; }  // the surface
  TouchCost cost() const override;
  std::shared_ptr<TouchedLayer> layer(const Layer&, const TouchWay&, const TouchWork& work) const override;

 private:
  // Shared with the work that makes it ready, which may outlive the model.
  struct State {
    SolidBlock block;
    MemoryAccount account;
    Charge charge;
    mutable std::mutex mutex;  // held for looking things up only
    std::shared_ptr<Device> device;
    std::shared_ptr<TouchedLayer> ready;  // on that device
    std::shared_ptr<State> before;        // that is being made ready, until this one is
    bool asked = false;
    std::exception_ptr error;
    std::chrono::steady_clock::time_point retry{};
  };
  // What is ready, and on which device; null: nothing.
  static std::pair<std::shared_ptr<TouchedLayer>, std::shared_ptr<Device>> ready(const State&);
  std::shared_ptr<State> being_made_before() const;
  // Ready with what `before` solves with, if that is ready on this device (null: on any).
  static bool take_over(State&, const State& before, const std::shared_ptr<Device>&);
  const std::shared_ptr<State> state_;
};

}  // namespace teletact::service
