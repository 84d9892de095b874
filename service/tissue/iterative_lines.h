// The lines of a model that are touched by conjugate gradients, with one solver for each device. When others
// need room their columns are given back, and then what is left of lines that nobody touches.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <utility>

#include "service/tissue/iterative_line.h"

namespace teletact::service {

class IterativeLines final : public Reclaimable {
 public:
  using MakeSolver = std::function<std::shared_ptr<SharedSolver>()>;
  using MakeLine = std::function<std::shared_ptr<IterativeLine>(std::shared_ptr<SharedSolver>)>;
  // The line, made if it is not kept; both makers may throw.
  std::shared_ptr<IterativeLine> at(std::size_t line, const std::shared_ptr<Device>&, const MemoryAccount&,
                                    const MakeSolver&, const MakeLine&);
  std::uint64_t last_use() const override;
  bool give_back() override;

 private:
  using Key = std::pair<std::size_t, std::shared_ptr<Device>>;
  std::mutex making_;         // one at a time; not held by give_back()
  mutable std::mutex mutex_;  // of the maps
  std::map<std::shared_ptr<Device>, std::shared_ptr<SharedSolver>> solvers_;
  std::map<Key, std::shared_ptr<IterativeLine>> lines_;
};

}  // namespace teletact::service
