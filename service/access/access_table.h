// Who may do what, at one moment: never changed, replaced as a whole.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace teletact::service {

// What each role may do. For people the table stands in docs/guide/service.md (Security).
enum class Role { kPatient, kOperator, kObserver, kAdministrator };
inline constexpr std::array kRoles{Role::kPatient, Role::kOperator, Role::kObserver, Role::kAdministrator};

// What a call needs of who makes it.
enum class Need {
  kKnown,    // to be known: GetInfo
  kRead,     // GetScene, ListScenes, Observe
  kFeel,     // Touch, without steering
  kSteer,    // Touch that may steer
  kPublish,  // CreateScene, PublishSlice, Estimate
  kFollow,   // WatchFinger
  kDelete,   // DeleteScene
};

bool allows(Role, Need);

// "operator", as the file of access names it.
const char* name_of(Role);
std::optional<Role> role_of(std::string_view name);
// What one does who needs it: "steer a touch of".
const char* words_of(Need);
// Who may: "operator or administrator".
std::string roles_for(Need);

// Tokens: secrets by which a client shows who it is. The service keeps their SHA-256 alone.
using Digest = std::array<unsigned char, 32>;  // SHA-256

// Throws std::runtime_error where the cryptographic library fails.
Digest digest_of(std::string_view token);
// 64 hexadecimal digits, of either case; else none.
std::optional<Digest> digest_from(std::string_view hex);

using WallClock = std::chrono::system_clock;

// A call that its caller may not make, or does not show who it is.
struct AccessRefused : std::runtime_error {
  enum class Why {
    kUnknown,  // nobody, nobody who is known, or no longer
    kDenied,   // known, without the role
  };
  AccessRefused(Why why_, const std::string& what) : std::runtime_error(what), why(why_) {}
  Why why;
};

// An entry of the file.
struct Principal {
  std::string name;
  std::optional<Digest> token = {};
  std::string certificate = {};  // a name in a client's certificate; empty: none
  std::optional<WallClock::time_point> expires = {};
  std::map<std::string, Role> roles = {};  // by scene; "*": every scene that is not named
};

// By which a caller shows who it is.
struct Proof {
  std::optional<Digest> token = {};                 // goes before the certificate
  std::vector<std::string> certificate_names = {};  // that its authority vouches for
  std::optional<WallClock::time_point> certificate_ends = {};
};

// What a call is about.
struct Wanted {
  Need need;
  // "": no scene, a role for any of them is enough. kEveryScene: a role for all that have none of their own.
  std::string scene;
};
inline const std::string kEveryScene = "*";

class AccessTable {
 public:
  AccessTable() = default;
  // Throws std::invalid_argument: a name, token or certificate twice; an entry without either, or without
  // roles.
  explicit AccessTable(std::vector<Principal>);

  // Who shows this, by `now`. Throws AccessRefused(kUnknown).
  const Principal& known(const Proof&, WallClock::time_point now) const;
  // Throws AccessRefused(kDenied), which names the principal, what was wanted and who may.
  static void require(const Principal&, const Wanted&);
  static bool may(const Principal&, const Wanted&);

  std::size_t size() const { return principals_.size(); }

 private:
  std::vector<Principal> principals_;
  std::map<Digest, std::size_t> by_token_;
  std::map<std::string, std::size_t, std::less<>> by_certificate_;
};

}  // namespace teletact::service
