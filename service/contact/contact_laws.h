// The contact laws of one model (T7): one for each fingertip, layer, path and tolerance, sampled when it is
// first asked for, beside touch, and shared by every stream from then on.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/contact_law.h"
#include "service/base/memory.h"
#include "service/contact/touch_model.h"

namespace teletact::service {

// What of a law is known. Each column states what the force around it may be off by.
struct ContactLaw {
  std::vector<LawColumn> columns;  // by z, then x; versions are the sender's to say
  bool whole = false;              // else more will come, or some will be corrected
};

// Samples one law, for one thread at a time.
class LawSampling {
 public:
  using Clock = TouchedLayer::Clock;
  virtual ~LawSampling() = default;
  // Works a little at least, until all is done or more would begin after `until`. True when done. What it
  // throws ends it: it may be begun anew later.
  virtual bool advance(Clock::time_point until) = 0;
  // Those that are known by now, by z, then x, with what they state; none of a lane is missing between two of
  // them. A column that is corrected is not altered any more.
  virtual std::vector<LawColumn> columns() const = 0;
};

// Thread-safe.
class ContactLaws : public std::enable_shared_from_this<ContactLaws> {
 public:
  // Tips, layers and tolerances of one model: another takes the place of the one that was asked for least
  // recently.
  static constexpr std::size_t kMax = 8;

  // A level layer has one, unless it is a plane's and solved iteratively.
  static bool has(const Layer&, const TouchWay&, const Region&);
  explicit ContactLaws(MemoryAccount account);
  ~ContactLaws();
  // What is known by now: the rest is being sampled, which this asks `work` for, in the client's turn, in
  // small steps, and from where the first who asked has the finger (near_m). Null while nothing is known, and
  // for good where it has no law, or there is no room. `touched`: the layer, ready, to be touched this way,
  // for a law.
  std::shared_ptr<const ContactLaw> get(const Fingertip&, const Layer&, const TouchWay&,
                                        const std::shared_ptr<TouchedLayer>& touched, const Region&,
                                        const Vector3& near_m, const TouchWork& work);

 private:
  struct Entry {
    Fingertip tip;
    Layer layer;
    SolvePath path;
    std::optional<Tolerance> tolerance;
    std::function<std::unique_ptr<LawSampling>()> make;    // by its job, as it takes some time
    std::unique_ptr<LawSampling> sampler;                  // while it is at work, by its job
    std::uint64_t asked = 0;                               // counts with every question
    std::optional<TouchedLayer::Clock::time_point> retry;  // it failed: not to be begun anew before
    std::shared_ptr<const ContactLaw> law;
    Charge charge;
  };
  void post(const std::shared_ptr<Entry>&, const TouchWork&, const std::string& client);
  bool step(Entry&, std::chrono::steady_clock::time_point until);
  bool publish(Entry&, bool whole);  // false: there is no room

  const MemoryAccount account_;
  std::mutex mutex_;  // held for looking things up only
  std::vector<std::shared_ptr<Entry>> entries_;
  std::uint64_t asked_ = 0;
};

}  // namespace teletact::service
