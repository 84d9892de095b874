#include "service/device/cancellation.h"

#include <utility>

namespace teletact::service {

namespace {

thread_local const CancellationCheck* latest = nullptr;
thread_local double waited = 0;

}  // namespace

CancellationCheck::CancellationCheck(std::function<void()> look) : look_(std::move(look)), before_(latest) {
  latest = this;
}

CancellationCheck::~CancellationCheck() {
  latest = before_;
}

void check_cancelled() {
  for (const CancellationCheck* l = latest; l; l = l->before_) l->look_();
}

bool is_cancellable() {
  return latest != nullptr;
}

double waited_s() {
  return waited;
}

void add_waited(double seconds) {
  waited += seconds;
}

}  // namespace teletact::service
