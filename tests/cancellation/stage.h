// A service of this process in the states that are tried: with its scenes, full, and with scenes that come
// and go.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "tests/cancellation/fuzz/call.h"
#include "tests/rpc/running_server.h"

namespace teletact::test {

// A service with the scenes that the calls are about.
class Service {
 public:
  static constexpr std::size_t kScenes = 3;  // that make_ready() makes
  explicit Service(bool ready)
      : server_("127.0.0.1:0", "", limits(), service::tissue_models(), {}, false, {}, patient()) {
    if (ready) make_ready();
  }
  void make_ready() {
    server_->make_ready();
    for (const auto& request :
         {service::uniform_scene("small", 10e3, 0.05, 0.03), service::uniform_scene("still"),
          service::uniform_scene("large", 10e3, 0.4, 0.2)})
      EXPECT_TRUE(create(request).ok());
  }
  service::RunningServer& running() { return server_; }
  const std::string& address() { return server_->address(); }
  service::Calls& calls() { return server_->core().calls; }

  grpc::Status create(const v1::CreateSceneRequest& request) { return server_.create(request); }
  void remove(const std::string& id) { server_.remove(id); }
  std::vector<std::string> scenes() {
    std::vector<std::string> ids;
    for (const auto& scene : server_->core().scenes.list()) ids.push_back(scene->id());
    return ids;
  }
  // Leaves what make_ready() made.
  void sweep() {
    for (const std::string& id : scenes())
      if (id != "small" && id != "still" && id != "large") remove(id);
  }
  // Every slot is given back in time.
  void expect_calls(std::size_t expected, const char* when) {
    const auto end = Later::Clock::now() + std::chrono::seconds(30);
    while (calls().count() > expected && Later::Clock::now() < end)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_EQ(calls().count(), expected) << "slots held after " << when;
  }
  // What calls hold while they are served, given back in time; scenes, lines and engines may stay.
  void expect_bytes_of_calls_returned() {
    const auto held = [this] {
      std::string held;
      for (const auto& use : server_->core().memory->uses())
        for (const char* kind : {"uploads", "estimates", "estimating", "answers", "condensing", "solving"})
          if (use.kind == kind && use.bytes > 0) held += use.kind + " " + std::to_string(use.bytes) + " B ";
      return held;
    };
    const auto end = Later::Clock::now() + std::chrono::seconds(30);
    while (!held().empty() && Later::Clock::now() < end)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_EQ(held(), "");
  }

 private:
  static service::Limits limits() {
    service::Limits limits;
    limits.max_touch_streams = 64;  // all together fewer than calls of one connection
    limits.max_observers = 16;
    return limits;
  }
  // Most of these calls come to nothing, and some before their client has made one that is let through.
  static service::ConnectionLimits patient() {
    service::ConnectionLimits limits;
    limits.wasted = service::Allowance(1e9);
    limits.unknown_bytes_per_second = 1e12;
    limits.unknown_calls = service::Allowance(1e9);
    limits.unknown_bytes = service::Allowance(1e12);
    return limits;
  }
  service::RunningServer server_;
};

inline Targets usual_targets() {
  Targets targets{{"small"}, "large", {}};
  for (int k = 0; k < 24; ++k) targets.made.push_back("made-" + std::to_string(k));
  return targets;
}

// Holds every slot and every scene of a service while it lives.
class Full {
 public:
  static constexpr int kMoreThanAllowed = 1000;
  explicit Full(Service& service) : service_(service), channel_(service.running().channel()) {
    for (const Method method : {Method::kTouch, Method::kWatchFinger, Method::kObserve, Method::kEstimate})
      for (int k = 0; hold(method); ++k)
        if (k > kMoreThanAllowed) throw std::runtime_error("nothing bounds the calls");
    int made = 0;
    while (made < kMoreThanAllowed &&
           service.create(service::uniform_scene("held-" + std::to_string(made), 10e3, 0.02, 0.01)).ok())
      ++made;
    EXPECT_GT(holders_.size(), 3U);
    EXPECT_LT(made, kMoreThanAllowed);
  }
  ~Full() {
    for (const auto& call : holders_) call->cancel();
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return ended_ == holders_.size(); });
  }

 private:
  // False when it is refused.
  bool hold(Method method) {
    const std::size_t before = service_.calls().count(), ended = ended_;
    Plan plan{{method, ServiceState::kServing, End::kReset, Content::kValid},
              script_of_holder(method, "small"),
              "",
              {},
              {}};
    holders_.push_back(std::make_shared<Call>(std::move(plan), [this](const Call&, const grpc::Status&) {
      const std::lock_guard lock(mutex_);
      ++ended_;
      changed_.notify_all();
    }));
    holders_.back()->start(channel_, later_);
    std::unique_lock lock(mutex_);
    const auto soon = Later::Clock::now() + std::chrono::seconds(30);
    while (ended_ == ended && service_.calls().count() <= before) {
      if (Later::Clock::now() > soon) throw CallHangs("a holder: " + holders_.back()->progress());
      changed_.wait_for(lock, std::chrono::milliseconds(1));
    }
    return ended_ == ended;
  }
  Service& service_;
  std::shared_ptr<grpc::Channel> channel_;
  std::vector<std::shared_ptr<Call>> holders_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::size_t ended_ = 0;
  Later later_;
};

// Scenes that come and go.
class Deleting {
 public:
  explicit Deleting(Service& service)
      : thread_([this, &service] {
          for (std::size_t k = 0; !stop_; ++k) {
            const std::string id = ids()[k % ids().size()];
            service.create(service::uniform_scene(id, 10e3, 0.05, 0.03));
            std::this_thread::sleep_for(std::chrono::milliseconds(k % 7));
            service.remove(ids()[(k + 1) % ids().size()]);
          }
        }) {}
  ~Deleting() {
    stop_ = true;
    thread_.join();
  }
  static const std::vector<std::string>& ids() {
    static const std::vector<std::string> ids{"doomed-0", "doomed-1", "doomed-2"};
    return ids;
  }
  static Targets targets() {
    Targets targets = usual_targets();
    targets.touched = ids();
    targets.large.clear();
    targets.made.insert(targets.made.end(), ids().begin(), ids().end());
    return targets;
  }

 private:
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace teletact::test
