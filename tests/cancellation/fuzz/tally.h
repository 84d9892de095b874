// What the calls of a run ended with, counted; what was not to be, told. Thread-safe.
#pragma once

#include <grpcpp/support/status.h>

#include <atomic>
#include <map>
#include <mutex>
#include <string>
#include <tuple>
#include <vector>

#include "tests/cancellation/fuzz/case.h"

namespace teletact::test {

class Tally {
 public:
  void add(const Case& tried, const grpc::Status& status);
  std::size_t calls() const { return calls_; }
  // Of the calls that are chosen.
  template <class Chosen>  // bool(const Case&, grpc::StatusCode)
  std::size_t count(Chosen&& chosen) const {
    const std::lock_guard lock(mutex_);
    std::size_t all = 0;
    for (const auto& [key, count] : counts_) all += chosen(std::get<0>(key), std::get<1>(key)) ? count : 0;
    return all;
  }
  // Cases of these that were never tried.
  std::vector<std::string> untried(const std::vector<Method>&) const;
  // Statuses that the contract does not list, one line per case and code with its first message.
  std::vector<std::string> unlisted() const;
  // Calls by state, by end, by content and by status, one line per method.
  std::string table() const;

 private:
  std::atomic<std::size_t> calls_{0};
  mutable std::mutex mutex_;
  std::map<std::tuple<Case, grpc::StatusCode>, std::size_t> counts_;
  std::map<std::tuple<Case, grpc::StatusCode>, std::string> unlisted_;
};

}  // namespace teletact::test
