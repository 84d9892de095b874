#include "service/access/access.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>
#include <toml++/toml.h>

#include <algorithm>
#include <chrono>
#include <stdexcept>
#include <string_view>
#include <utility>
#include <vector>

#include "common/small_file.h"
#include "service/base/shown.h"

namespace teletact::service {

namespace {

constexpr std::size_t kMaxName = 64, kMaxCertificateName = 256, kMaxDescription = 500;
constexpr std::string_view kNames = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";

[[noreturn]] void wrong(const std::string& entry, std::string_view key, const std::string& why) {
  throw std::invalid_argument(fmt::format("{}: {}: {}", entry, key, why));
}

std::string text_in(const std::string& entry, std::string_view key, const toml::node& node) {
  if (!node.is_string()) wrong(entry, key, "must be a string, in quotes");
  return *node.value<std::string>();
}

Digest digest_in(const std::string& entry, std::string_view key, const toml::node& node) {
  const auto digest = digest_from(text_in(entry, key, node));
  if (!digest)
    wrong(entry, key,
          "must be 64 hexadecimal digits, a token's SHA-256 and never the token: tr -d '\\n' < FILE | "
          "sha256sum");
  return *digest;
}

std::string certificate_in(const std::string& entry, std::string_view key, const toml::node& node) {
  std::string name = text_in(entry, key, node);
  if (name.empty() || name.size() > kMaxCertificateName)
    wrong(entry, key, "give the certificate's common name, or one of its alternative names");
  return name;
}

WallClock::time_point expiry_in(const std::string& entry, std::string_view key, const toml::node& node) {
  using namespace std::chrono;
  const auto stated = node.value<toml::date_time>();
  if (!node.is_date_time() || !stated || !stated->offset)
    wrong(entry, key, "must be a date and time with an offset and no quotes, such as 2027-01-31T18:00:00Z");
  const year_month_day day{year(stated->date.year), month(stated->date.month),
                           std::chrono::day(stated->date.day)};
  return sys_days(day) + hours(stated->time.hour) + minutes(stated->time.minute) +
         seconds(stated->time.second) - minutes(stated->offset->minutes);
}

bool names_scenes(const std::string& text) {
  return text == kEveryScene ||
         (!text.empty() && text.size() <= kMaxName && text.find_first_not_of(kNames) == std::string::npos);
}

std::map<std::string, Role> roles_in(const std::string& entry, std::string_view key, const toml::node& node) {
  const toml::table* const table = node.as_table();
  if (!table) wrong(entry, key, "must be a table of scenes, such as { liver = \"operator\" }");
  std::map<std::string, Role> roles;
  for (const auto& [scene, stated] : *table) {
    const std::string name(scene.str()), where = fmt::format("{}.{}", key, shown(name));
    if (!names_scenes(name))
      wrong(entry, where, "no scene has such a name: [A-Za-z0-9_-]{1,64}, or '*' for every scene");
    const auto role = role_of(text_in(entry, where, stated));
    if (!role) wrong(entry, where, "must be patient, operator, observer or administrator");
    roles.emplace(name, *role);
  }
  return roles;
}

std::string name_in(const std::string& entry, const toml::table& table) {
  const toml::node* const node = table.get("name");
  if (!node) wrong(entry, "name", "is missing; give one, for messages and the log");
  std::string name = text_in(entry, "name", *node);
  const bool fits = !name.empty() && name.size() <= kMaxName &&
                    std::all_of(name.begin(), name.end(),
                                [](char c) { return c > ' ' && c <= '~' && c != '"' && c != '\''; });
  if (!fits) wrong(entry, "name", "must be 1 to 64 printable characters, no spaces, no quotes");
  return name;
}

Principal principal_in(const toml::node& node, std::size_t number) {
  std::string entry = fmt::format("entry {}", number);
  const toml::table* const table = node.as_table();
  if (!table) wrong(entry, "entry", "must be a table, [[entry]]");
  Principal principal{.name = name_in(entry, *table)};
  entry = fmt::format("entry '{}'", principal.name);
  for (const auto& [key, value] : *table) {
    const std::string_view name = key.str();
    if (name == "token_sha256")
      principal.token = digest_in(entry, name, value);
    else if (name == "certificate")
      principal.certificate = certificate_in(entry, name, value);
    else if (name == "expires")
      principal.expires = expiry_in(entry, name, value);
    else if (name == "roles")
      principal.roles = roles_in(entry, name, value);
    else if (name != "name")
      wrong(entry, shown(name), "unknown; one of name, token_sha256, certificate, expires, roles");
  }
  return principal;
}

AccessTable table_in(const toml::table& file) {
  for (const auto& [key, value] : file)
    if (key.str() != "entry") wrong(shown(key.str()), "unknown key", "the file has [[entry]] alone");
  const toml::array* const entries = file.get_as<toml::array>("entry");
  // A file that is being written is empty for a moment: it must not end every call.
  if (!entries || entries->empty())
    throw std::invalid_argument(
        "no entry: give at least one [[entry]]; to keep everybody out, give one that expired");
  std::vector<Principal> principals;
  for (const toml::node& entry : *entries) principals.push_back(principal_in(entry, principals.size() + 1));
  return AccessTable(std::move(principals));
}

}  // namespace

AccessTable read_access(const std::filesystem::path& path) {
  const std::string where = "--access " + path.string() + ": ";
  try {
    return table_in(toml::parse(read_small_file(path, kMaxAccessBytes)));
  } catch (const UnreadFile& error) {
    throw std::runtime_error(where + "cannot be read (" + error.what() +
                             "); give a file that this user may read");
  } catch (const toml::parse_error& error) {
    throw std::runtime_error(where + shown(error.description(), kMaxDescription) + ", line " +
                             std::to_string(error.source().begin.line));
  } catch (const std::invalid_argument& error) {
    throw std::runtime_error(where + error.what());
  }
}

Access::Access(std::filesystem::path file, Now now, std::chrono::milliseconds between)
    : file_(std::move(file)),
      now_(std::move(now)),
      seen_(seen_now()),
      table_(std::make_shared<const AccessTable>(read_access(file_))),
      watch_(between, "access_not_read", [this] { look(); }) {
  spdlog::info("event=access_read file=\"{}\" entries={}", file_.string(), table()->size());
}

std::shared_ptr<const AccessTable> Access::table() const {
  const std::lock_guard lock(mutex_);
  return table_;
}

void Access::log_refusal(const std::string& call, const AccessRefused& refused) const {
  refusals_.tell(PacedLog::Clock::now(), [&] { return fmt::format("{} why=\"{}\"", call, refused.what()); });
}

Access::Seen Access::seen_now() const {
  struct stat found {};
  if (::stat(file_.c_str(), &found) != 0) return {};
  return {found.st_dev, found.st_ino, found.st_size, found.st_mtim.tv_sec, found.st_mtim.tv_nsec};
}

void Access::look() {
  const Seen seen = seen_now();
  if (seen == seen_) return;
  auto table = std::make_shared<const AccessTable>(read_access(file_));
  spdlog::info("event=access_read file=\"{}\" entries={}", file_.string(), table->size());
  seen_ = seen;
  const std::lock_guard lock(mutex_);
  table_ = std::move(table);
  ++version_;
}

}  // namespace teletact::service
