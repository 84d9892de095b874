// One solver for all rows of a model on one device, used by one thread at a time. It is made when it is
// needed and gives back the device's memory when others need it.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>

#include "service/base/memory.h"
#include "service/tissue/elasticity_solver.h"

namespace teletact::service {

class SharedSolver final : public Reclaimable {
 public:
  // Makes the solver, and throws as its constructor does.
  SharedSolver(std::shared_ptr<Device> device, TissueGrid grid, const Supports& supports, Material material,
               ElasticitySolverOptions options, const MemoryAccount& account)
      : charge_(account.charge(Place::kHost, "solvers", kElementBytes * grid.elements())),
        device_(std::move(device)),
        grid_(std::move(grid)),
        supports_(supports),
        material_(std::move(material)),
        options_(std::move(options)) {
    options_.account = account;
    make();
  }

  template <class Work>
  auto with(Work work) {
    const std::lock_guard lock(mutex_);
    const InUse use(busy_);
    used_ = use_stamp();
    if (!solver_) make();
    return work(*solver_);
  }

  std::uint64_t last_use() const override { return used_; }
  bool give_back() override {
    if (busy_) return false;  // first: the thread that uses it may be the one that needs room
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock || !solver_) return false;
    solver_.reset();
    return true;
  }

 private:
  // Grid and material, here and in the solver, and the solver's marks.
  static constexpr std::size_t kElementBytes = 32;
  struct InUse {
    explicit InUse(std::atomic<bool>& busy_) : busy(busy_) { busy = true; }
    ~InUse() { busy = false; }
    std::atomic<bool>& busy;
  };
  void make() {
    auto made = std::make_unique<ElasticitySolver>(device_, grid_, supports_, options_);
    made->set_material(material_);
    solver_ = std::move(made);
  }

  const Charge charge_;
  const std::shared_ptr<Device> device_;
  const TissueGrid grid_;
  const Supports supports_;
  const Material material_;
  ElasticitySolverOptions options_;
  std::mutex mutex_;
  std::atomic<bool> busy_ = false;
  std::atomic<std::uint64_t> used_ = use_stamp();
  std::unique_ptr<ElasticitySolver> solver_;
};

}  // namespace teletact::service
