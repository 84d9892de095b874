#include "service/access/access_table.h"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <openssl/evp.h>

#include <algorithm>
#include <charconv>
#include <set>
#include <stdexcept>
#include <utility>

#include "service/base/shown.h"

namespace teletact::service {

bool allows(Role role, Need need) {
  switch (need) {
    case Need::kKnown:
    case Need::kRead:
      return true;
    case Need::kFeel:
      return role != Role::kPatient;
    case Need::kSteer:
      return role == Role::kOperator || role == Role::kAdministrator;
    case Need::kPublish:
    case Need::kFollow:
      return role == Role::kPatient || role == Role::kAdministrator;
    case Need::kDelete:
      return role == Role::kAdministrator;
  }
  return false;
}

const char* name_of(Role role) {
  return std::array{"patient", "operator", "observer", "administrator"}.at(static_cast<std::size_t>(role));
}

std::optional<Role> role_of(std::string_view name) {
  for (const Role role : kRoles)
    if (name == name_of(role)) return role;
  return std::nullopt;
}

const char* words_of(Need need) {
  return std::array{"ask about", "read", "touch", "steer a touch of", "publish into", "follow the finger of",
                    "delete"}
      .at(static_cast<std::size_t>(need));
}

std::string roles_for(Need need) {
  std::string names;
  for (const Role role : kRoles)
    if (allows(role, need)) names += (names.empty() ? "" : " or ") + std::string(name_of(role));
  return names;
}

Digest digest_of(std::string_view token) {
  Digest out;
  unsigned size = 0;
  if (EVP_Digest(token.data(), token.size(), out.data(), &size, EVP_sha256(), nullptr) != 1 ||
      size != out.size())
    throw std::runtime_error("SHA-256 cannot be computed");
  return out;
}

std::optional<Digest> digest_from(std::string_view hex) {
  Digest out;
  if (hex.size() != 2 * out.size()) return std::nullopt;
  for (std::size_t k = 0; k < out.size(); ++k) {
    const char* const begin = hex.data() + 2 * k;
    const auto read = std::from_chars(begin, begin + 2, out[k], 16);
    if (read.ec != std::errc() || read.ptr != begin + 2) return std::nullopt;
  }
  return out;
}

namespace {

constexpr const char* kGive =
    "give --token-file FILE, or, if the service has --tls-client-ca, --tls-certificate and --tls-key";

[[noreturn]] void unknown(const std::string& why) {
  throw AccessRefused(AccessRefused::Why::kUnknown, why);
}

[[noreturn]] void wrong(const Principal& entry, const char* key, const std::string& why) {
  throw std::invalid_argument(fmt::format("entry '{}': {}: {}", entry.name, key, why));
}

std::string text_of(WallClock::time_point at) {
  return fmt::format("{:%Y-%m-%dT%H:%M:%SZ}", fmt::gmtime(WallClock::to_time_t(at)));
}

// The role that counts for a scene: its own, where there is one.
std::optional<Role> role_for(const Principal& principal, const std::string& scene) {
  auto found = principal.roles.find(scene);
  if (found == principal.roles.end()) found = principal.roles.find(kEveryScene);
  if (found == principal.roles.end()) return std::nullopt;
  return found->second;
}

// " (observer there)"
std::string shown_role(const Principal& principal, const Wanted& wanted) {
  if (wanted.scene.empty()) return "";
  const auto role = role_for(principal, wanted.scene);
  return role ? fmt::format(" ({} there)", name_of(*role)) : std::string(" (no role there)");
}

std::string shown_scene(const Wanted& wanted) {
  if (wanted.scene.empty()) return "any scene";
  if (wanted.scene == kEveryScene) return "scenes without a name of their own in the file of access";
  return fmt::format("scene '{}'", shown(wanted.scene));
}

}  // namespace

AccessTable::AccessTable(std::vector<Principal> principals) : principals_(std::move(principals)) {
  std::set<std::string> names;
  for (std::size_t k = 0; k < principals_.size(); ++k) {
    const Principal& entry = principals_[k];
    if (!names.insert(entry.name).second) wrong(entry, "name", "stands twice; give each entry its own");
    if (!entry.token && entry.certificate.empty())
      wrong(entry, "token_sha256", "neither this nor certificate is given; give one");
    if (entry.roles.empty()) wrong(entry, "roles", "empty; give a role for a scene, or for '*', every scene");
    if (entry.token && !by_token_.emplace(*entry.token, k).second)
      wrong(entry, "token_sha256", "another entry has the same token; make one for each");
    if (!entry.certificate.empty() && !by_certificate_.emplace(entry.certificate, k).second)
      wrong(entry, "certificate", "another entry has the same; give each its own");
  }
}

const Principal& AccessTable::known(const Proof& proof, WallClock::time_point now) const {
  const Principal* found = nullptr;
  if (proof.token) {
    const auto entry = by_token_.find(*proof.token);
    if (entry == by_token_.end())
      unknown("the token is not known here, or no longer: ask the administrator for another (--token-file)");
    found = &principals_[entry->second];
  } else {
    if (proof.certificate_names.empty())
      unknown(fmt::format("the service requires authentication: {} (metadata 'authorization: Bearer TOKEN')",
                          kGive));
    for (const std::string& name : proof.certificate_names)
      if (const auto entry = by_certificate_.find(name); entry != by_certificate_.end() && !found)
        found = &principals_[entry->second];
    if (!found)
      unknown(
          fmt::format("no entry of the file of access is for this certificate, '{}': ask the "
                      "administrator for one (certificate = ...)",
                      shown(proof.certificate_names.front())));
    if (proof.certificate_ends && now >= *proof.certificate_ends)
      unknown(fmt::format("the certificate of {} ended at {}; ask for another (--tls-certificate)",
                          found->name, text_of(*proof.certificate_ends)));
  }
  if (found->expires && now >= *found->expires)
    unknown(fmt::format("the entry of {} expired at {}; ask the administrator for a new one", found->name,
                        text_of(*found->expires)));
  return *found;
}

bool AccessTable::may(const Principal& principal, const Wanted& wanted) {
  if (wanted.scene.empty())
    return std::any_of(principal.roles.begin(), principal.roles.end(),
                       [&](const auto& role) { return allows(role.second, wanted.need); });
  const auto role = role_for(principal, wanted.scene);
  return role && allows(*role, wanted.need);
}

void AccessTable::require(const Principal& principal, const Wanted& wanted) {
  if (may(principal, wanted)) return;
  throw AccessRefused(
      AccessRefused::Why::kDenied,
      fmt::format("{}{} may not {} {}: it takes the role {}", principal.name, shown_role(principal, wanted),
                  words_of(wanted.need), shown_scene(wanted), roles_for(wanted.need)));
}

}  // namespace teletact::service
