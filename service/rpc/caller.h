// Who makes a call and what it may do: known at the call's beginning, and asked for again once a second, or
// as soon as the file of access has changed.
#pragma once

#include <grpcpp/server_context.h>

#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "service/access/access.h"

namespace teletact::service {

class Caller {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kAgain{1};

  // Whoever calls may do everything where `access` is null.
  explicit Caller(std::shared_ptr<const Access> access) : access_(std::move(access)) {}

  // By what the call shows. Throws AccessRefused, as the next two do.
  void begin(const grpc::ServerContextBase&);
  // What the call is about, from now on.
  void require(const Wanted&);
  // That all of it may still be done.
  void look(Clock::time_point now);
  // The entry's, once it has begun; empty where whoever calls may do everything.
  const std::string& name() const { return name_; }
  // One line a second at most, of all callers. `call`: key=value pairs.
  void log(const std::string& call, const AccessRefused& refused) const {
    access_->log_refusal(call, refused);
  }
  // Whether this would be let through.
  bool may(const Wanted&) const;

 private:
  const std::shared_ptr<const Access> access_;
  Proof proof_;
  std::string name_;
  mutable std::mutex mutex_;
  std::vector<Wanted> wanted_;  // one, or two of an estimate
  Clock::time_point next_{};    // these of who looks
  std::uint64_t seen_ = 0;
};

// What a caller shows: the token of "authorization: Bearer TOKEN", and its certificate, where the
// connection's authority vouches for it. Throws AccessRefused for a header of another form,
// and for two.
Proof proof_in(const grpc::ServerContextBase&);

}  // namespace teletact::service
