#include "tests/cancellation/fuzz/traffic.h"

#include <algorithm>

namespace teletact::test {

Traffic::Traffic(std::string address, std::uint64_t seed, Tally& tally)
    : address_(std::move(address)), tally_(tally), random_(seed) {
  constexpr int kChannels = 4;
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  // As client/link's: with retries a call never ends, now and then, whose service drains under it.
  arguments.SetInt(GRPC_ARG_ENABLE_RETRIES, 0);
  for (int k = 0; k < kChannels; ++k)
    channels_.push_back(grpc::CreateCustomChannel(address_, grpc::InsecureChannelCredentials(), arguments));
}

Traffic::~Traffic() {
  std::unique_lock lock(mutex_);
  for (const auto& call : going_on_) call->cancel();
  ended_.wait(lock, [this] { return going_on_.empty(); });
}

const std::shared_ptr<grpc::Channel>& Traffic::channel_to_be_reset() {
  const auto now = Later::Clock::now();
  if (!connection_ || now >= connection_ends_) {
    connection_ = std::make_shared<ResettableConnection>(address_);
    const std::chrono::microseconds life(static_cast<std::int64_t>(random_.within(100, 30'000)));
    connection_ends_ = now + life;
    later_.after(life, [connection = connection_] { connection->reset(); });
  }
  return connection_->channel();
}

void Traffic::start(const Case& tried, const Targets& targets) {
  wait_until_at_most(kMaxAtOnce - 1);
  const auto call = std::make_shared<Call>(plan_for(tried, targets, random_),
                                           [this](const Call& ended, const grpc::Status& status) {
                                             tally_.add(ended.tried(), status);
                                             const std::lock_guard lock(mutex_);
                                             going_on_.erase(const_cast<Call&>(ended).shared_from_this());
                                             ended_.notify_all();
                                           });
  {
    const std::lock_guard lock(mutex_);
    going_on_.insert(call);
  }
  call->start(tried.end == End::kReset ? channel_to_be_reset() : random_.one_of(channels_), later_);
}

void Traffic::wait() {
  wait_until_at_most(0);
}

void Traffic::wait_until_at_most(std::size_t calls) {
  std::unique_lock lock(mutex_);
  if (ended_.wait_for(lock, kLongestCall, [&] { return going_on_.size() <= calls; })) return;
  std::string which;
  for (const auto& call : going_on_) which += "\n  " + call->progress();
  throw CallHangs("calls that do not end:" + which);
}

std::vector<Case> shuffled_cases(ServiceState state, const std::vector<Share>& shares, Random& random) {
  std::vector<Case> cases;
  for (const Share& share : shares)
    for (std::size_t k = 0; k < share.times; ++k)
      for (const End end : kEnds)
        for (const Content content : kContents) cases.push_back({share.method, state, end, content});
  std::shuffle(cases.begin(), cases.end(), random.engine());
  return cases;
}

}  // namespace teletact::test
