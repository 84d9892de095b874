#include "tests/cancellation/fuzz/tally.h"

#include <fmt/format.h>

#include <set>

namespace teletact::test {

void Tally::add(const Case& tried, const grpc::Status& status) {
  const std::lock_guard lock(mutex_);
  const std::tuple key{tried, status.error_code()};
  ++counts_[key];
  ++calls_;
  if (!may_end_with(tried, status.error_code())) unlisted_.try_emplace(key, status.error_message());
}

std::vector<std::string> Tally::untried(const std::vector<Method>& methods) const {
  const std::lock_guard lock(mutex_);
  std::set<Case> tried;
  for (const auto& [key, count] : counts_) tried.insert(std::get<Case>(key));
  std::vector<std::string> names;
  for (const auto method : methods)
    for (const auto state : kStates)
      for (const auto end : kEnds)
        for (const auto content : kContents)
          if (const Case one{method, state, end, content}; !tried.contains(one))
            names.push_back(name_of(one));
  return names;
}

std::vector<std::string> Tally::unlisted() const {
  const std::lock_guard lock(mutex_);
  std::vector<std::string> lines;
  for (const auto& [key, message] : unlisted_)
    lines.push_back(fmt::format("{}: {} ({} times), \"{}\"", name_of(std::get<Case>(key)),
                                name_of(std::get<grpc::StatusCode>(key)), counts_.at(key),
                                message.substr(0, 200)));
  return lines;
}

std::string Tally::table() const {
  std::set<grpc::StatusCode> codes;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [key, count] : counts_) codes.insert(std::get<grpc::StatusCode>(key));
  }
  std::string text;
  for (const auto method : kMethods) {
    const std::size_t calls = count([&](const Case& c, auto) { return c.method == method; });
    if (calls == 0) continue;
    text += fmt::format("{:16}{:>8}:", name_of(method), calls);
    const auto add = [&](const auto& list, auto&& is) {
      for (const auto one : list)
        if (const std::size_t n =
                count([&](const Case& c, auto code) { return c.method == method && is(c, code) == one; }))
          text += fmt::format(" {} {},", name_of(one), n);
      text.back() = ';';
    };
    add(kStates, [](const Case& c, auto) { return c.state; });
    add(kEnds, [](const Case& c, auto) { return c.end; });
    add(kContents, [](const Case& c, auto) { return c.content; });
    add(codes, [](const Case&, auto code) { return code; });
    text.back() = '\n';
  }
  return text;
}

}  // namespace teletact::test
