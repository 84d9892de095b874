// The contact laws of one model (T7): one for each fingertip and layer, sampled when it is first asked for,
// beside touch, and shared by every stream from then on.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "law/contact_law.h"
#include "service/contact/touch_model.h"
#include "service/limits/memory.h"

namespace teletact::service {

// A law that is done: what is interpolated is off by about `tolerances` x (choices::kLawShare of the force +
// kLawFloor) at most, measured at poses that it was not made from.
struct ContactLaw {
  std::vector<LawColumn> columns;  // by x; versions are the sender's to say
  double tolerances = 0;
  std::size_t solves = 0;  // contacts that it took
};

class LawSampler;

// Thread-safe.
class ContactLaws : public std::enable_shared_from_this<ContactLaws> {
 public:
  // Tips and layers of one model: another takes the place of the one that was asked for least recently.
  static constexpr std::size_t kMost = 8;

  explicit ContactLaws(MemoryAccount account);
  ~ContactLaws();
  // Null while it is being sampled, which this asks `work` for, in the client's turn
  // and in small steps; and for good where the
  // model has none: its layer is not level, it is solved iteratively, or there is no room. [begin_m, end_m]:
  // of x. `touched`: the layer, ready.
  std::shared_ptr<const ContactLaw> get(const Fingertip&, const Layer&,
                                        const std::shared_ptr<TouchedLayer>& touched, double begin_m,
                                        double end_m, const TouchWork& work, const std::string& client);

 private:
  struct Entry {
    Fingertip tip;
    Layer layer;
    double near_m = 0;                    // where sampling begins
    std::unique_ptr<LawSampler> sampler;  // while it is at work, by its job
    std::uint64_t asked = 0;              // counts with every question
    std::shared_ptr<const ContactLaw> law;
    Charge charge;
  };
  void post(const std::shared_ptr<Entry>&, const TouchWork&, const std::string& client);
  bool step(Entry&, std::chrono::steady_clock::time_point until);
  void finish(Entry&);

  const MemoryAccount account_;
  std::mutex mutex_;  // held for looking things up only
  std::vector<std::shared_ptr<Entry>> entries_;
  std::uint64_t asked_ = 0;
};

}  // namespace teletact::service
