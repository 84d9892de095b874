// The compliances of one model that touches ask for. Making one ready takes from milliseconds to seconds, so
// it is done elsewhere: a touch gets one where it is there, and nothing while it is being made.
#pragma once

#include <chrono>
#include <exception>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <utility>

#include "service/contact/touch_model.h"
#include "service/tissue/tissue_model.h"

namespace teletact::service {

// Thread-safe.
class PreparedCompliances : public std::enable_shared_from_this<PreparedCompliances> {
 public:
  // One that could not be made is tried again after this long; until then asking for it says why.
  static constexpr std::chrono::seconds kRetry{1};

  explicit PreparedCompliances(std::shared_ptr<const TissueModel> model) : model_(std::move(model)) {}

  // The compliance of the row, by PCG on `device` or, where that is null, condensed. Null while it is being
  // made, which this asks `work` for, in the client's turn. Throws what making it throws, here or elsewhere.
  std::shared_ptr<Compliance> get(std::size_t row, const std::shared_ptr<Device>& device,
                                  const TouchWork& work, const std::string& client);

 private:
  using Clock = std::chrono::steady_clock;
  using Key = std::pair<std::size_t, std::shared_ptr<Device>>;
  struct Entry {
    std::set<std::string> asked;          // clients in whose turns it is to be made; none: it is not
    std::weak_ptr<Compliance> iterative;  // condensed ones are the model's to keep
    std::exception_ptr error;             // why it could not be made, the last time
    Clock::time_point retry{};
  };
  std::shared_ptr<Compliance> make(const Key&) const;
  void make_for_others(const Key&);

  const std::shared_ptr<const TissueModel> model_;
  std::mutex mutex_;  // held for looking things up only
  std::map<Key, Entry> entries_;
};

}  // namespace teletact::service
