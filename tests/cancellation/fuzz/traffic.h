// Many calls at once on one service in one state.
#pragma once

#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "tests/cancellation/fuzz/call.h"
#include "tests/cancellation/fuzz/tally.h"
#include "tests/support/resettable_connection.h"

namespace teletact::test {

class Traffic {
 public:
  static constexpr std::size_t kMaxAtOnce = 96;
  // From the end that its client made of a call to its status. The contract's own longest is WatchFinger's
  // 10 s without an acknowledgement.
  static constexpr std::chrono::seconds kLongestCall{40};

  // `address`: "127.0.0.1:port".
  Traffic(std::string address, std::uint64_t seed, Tally& tally);
  ~Traffic();  // ends what still goes on

  // Starts the call once fewer than kMaxAtOnce are going on. Throws CallHangs.
  void start(const Case& tried, const Targets& targets);
  // Returns once all have ended. Throws CallHangs.
  void wait();

 private:
  void wait_until_at_most(std::size_t calls);
  // Calls that end with a reset share a connection that lives for some milliseconds.
  const std::shared_ptr<grpc::Channel>& channel_to_be_reset();

  const std::string address_;
  Tally& tally_;
  Random random_;
  std::vector<std::shared_ptr<grpc::Channel>> channels_;
  std::shared_ptr<ResettableConnection> connection_;
  Later::Clock::time_point connection_ends_{};

  std::mutex mutex_;
  std::condition_variable ended_;
  std::set<std::shared_ptr<Call>> going_on_;
  Later later_;
};

// Each method with all ends and all contents, so many times.
struct Share {
  Method method;
  std::size_t times;
};
// In an order of the seed's.
std::vector<Case> shuffled_cases(ServiceState state, const std::vector<Share>& shares, Random& random);

}  // namespace teletact::test
