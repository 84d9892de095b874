#include "service/device/look.h"

#include <utility>

namespace teletact::service {

namespace {

thread_local const Looking* latest = nullptr;
thread_local double waited = 0;

}  // namespace

Looking::Looking(std::function<void()> look) : look_(std::move(look)), before_(latest) {
  latest = this;
}

Looking::~Looking() {
  latest = before_;
}

void look() {
  for (const Looking* l = latest; l; l = l->before_) l->look_();
}

bool looked_after() {
  return latest != nullptr;
}

double waited_s() {
  return waited;
}

void add_waited(double seconds) {
  waited += seconds;
}

}  // namespace teletact::service
