"""Stand-ins for engines that are not at hand: they take the calls of decks and tell what they were given."""

from __future__ import annotations

from typing import Any


class EngineStub:
    """DEM-Engine's module and solver in one, as far as the deck goes."""

    def __init__(self) -> None:
        self.templates: list[tuple] = []
        self.ran = 0.0

    def DEMSolver(self) -> EngineStub:
        return self

    def LoadMaterial(self, properties: dict[str, float]) -> str:
        self.material = properties
        return "grain"

    def InstructBoxDomainDimension(self, x: tuple, y: tuple, z: tuple) -> None:
        self.box = (x, y, z)

    def InstructBoxDomainBoundingBC(self, which: str, material: str) -> None:
        assert (which, material) == ("top_open", "grain")

    def LoadClumpType(self, mass: float, moi: list[float], path: str, material: str) -> tuple:
        self.templates.append((mass, tuple(moi), path))
        return self.templates[-1]

    def AddClumps(self, kinds: list[tuple], places: list[list[float]]) -> EngineStub:
        self.added = (kinds, places)
        return self

    def SetOriQ(self, turns: list[list[float]]) -> None:
        self.turns = turns

    def SetInitTimeStep(self, step: float) -> None:
        self.step = step

    def SetGravitationalAcceleration(self, gravity: list[float]) -> None:
        self.gravity = gravity

    def SetMaxVelocity(self, speed: float) -> None:
        assert speed > 0

    SetErrorOutVelocity = SetMaxVelocity

    def CreateInspector(self, what: str) -> EngineStub:
        assert what in ("clump_kinetic_energy", "clump_min_z", "clump_max_z")
        return self

    def GetValue(self) -> float:
        return 0.0

    def Initialize(self) -> None:
        self.ready = True

    def DoDynamicsThenSync(self, seconds: float) -> None:
        assert self.ready
        self.ran += seconds

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"DEM-Engine's stand-in has no '{name}'")


_MERCURY = r"""
#pragma once
#include <iostream>
#include <string>
#include <vector>
typedef double Mdouble;
struct Vec3D { double X, Y, Z; Vec3D(double x, double y, double z) : X(x), Y(y), Z(z) {} };
struct Matrix3D {
    double m[9];
    Matrix3D(double a, double b, double c, double d, double e, double f, double g, double h, double i)
        : m{a, b, c, d, e, f, g, h, i} {}
};
struct MatrixSymmetric3D {
    double m[6];
    MatrixSymmetric3D(double a, double b, double c, double d, double e, double f) : m{a, b, c, d, e, f} {}
};
struct ParticleSpecies {};
struct LinearViscoelasticFrictionSpecies : ParticleSpecies {
    void setDensity(double) {}
    void setStiffness(double) {}
    void setDissipation(double) {}
    void setSlidingStiffness(double) {}
    void setSlidingDissipation(double) {}
    void setSlidingFrictionCoefficient(double) {}
};
struct InfiniteWall {
    void setSpecies(const ParticleSpecies*) {}
    void set(Vec3D, Vec3D) {}
};
struct ClumpParticle {
    int pebbles = 0;
    double mass = 0;
    std::vector<double> inertia, place, axes;
    void setSpecies(const ParticleSpecies*) {}
    void setClump() {}
    void setRadius(double) {}
    void addPebble(Vec3D, double) { pebbles++; }
    void setPrincipalDirections(Matrix3D d) { axes.assign(d.m, d.m + 9); }
    void setInitInertia(MatrixSymmetric3D i) { inertia.assign(i.m, i.m + 6); }
    void setClumpMass(double m) { mass = m; }
    void setDamping(double) {}
    void setPosition(const Vec3D& p) { place = {p.X, p.Y, p.Z}; }
    void setVelocity(const Vec3D&) {}
    void setAngularVelocity(const Vec3D&) {}
};
struct SpeciesHandler {
    LinearViscoelasticFrictionSpecies species;
    LinearViscoelasticFrictionSpecies* copyAndAddObject(const LinearViscoelasticFrictionSpecies&) {
        return &species;
    }
    ParticleSpecies* getObject(unsigned) { return &species; }
};
struct WallHandler { void copyAndAddObject(const InfiniteWall&) { std::cout << "WALL\n"; } };
struct ParticleHandler {
    void copyAndAddObject(const ClumpParticle& p) {
        std::cout.precision(17);
        std::cout << "GRAIN " << p.pebbles << " " << p.mass;
        for (double v : p.inertia) std::cout << " " << v;
        for (double v : p.place) std::cout << " " << v;
        for (double v : p.axes) std::cout << " " << v;
        std::cout << "\n";
    }
};
class Mercury3D {
public:
    virtual ~Mercury3D() {}
    virtual void setupInitialConditions() {}
    void setName(const std::string&) {}
    void setGravity(Vec3D) {}
    void setMin(const Vec3D&) {}
    void setMax(const Vec3D&) {}
    void setTimeStep(double s) { step = s; }
    void setTimeMax(double t) { end = t; }
    void setSaveCount(unsigned) {}
    void setHGridMaxLevels(unsigned) {}
    void removeOldFiles() const {}
    void solve() { setupInitialConditions(); std::cout << "SOLVE " << step << " " << end << "\n"; }
    SpeciesHandler speciesHandler;
    WallHandler wallHandler;
    ParticleHandler particleHandler;
private:
    double step = 0, end = 0;
};
"""
_THE_SAME = '#include "Mercury3D.h"\n'
MERCURY = {
    "Mercury3D.h": _MERCURY,
    "Walls/InfiniteWall.h": _THE_SAME,
    "Species/LinearViscoelasticFrictionSpecies.h": _THE_SAME,
    "Particles/ClumpParticle.h": _THE_SAME,
    # Beside the driver's folder, as in MercuryDPM's Drivers/Clump.
    "../Drivers/ClumpHeaders/Mercury3DClump.h": _THE_SAME + "class Mercury3Dclump : public Mercury3D {};\n",
}

_MECHSYS = r"""
#pragma once
#include <cmath>
#include <iostream>
#include <vector>
struct Vec3_t {
    double v[3];
    Vec3_t(double x = 0, double y = 0, double z = 0) : v{x, y, z} {}
    double& operator()(int i) { return v[i]; }
};
inline Vec3_t operator*(double a, Vec3_t const & b) { return Vec3_t(a*b.v[0], a*b.v[1], a*b.v[2]); }
struct Quaternion_t {
    double v[4];
    double & operator()(int i) { return v[i]; }
    double operator()(int i) const { return v[i]; }
};
inline void NormalizeRotation(double angle, Vec3_t const & axis, Quaternion_t & q) {
    q.v[0] = std::cos(angle/2);
    for (int i = 0; i < 3; i++) q.v[i+1] = std::sin(angle/2)*axis.v[i];
}
inline void QuaternionProduct(Quaternion_t const & a, Quaternion_t const & b, Quaternion_t & c) {
    c.v[0] = a(0)*b(0) - a(1)*b(1) - a(2)*b(2) - a(3)*b(3);
    c.v[1] = a(0)*b(1) + a(1)*b(0) + a(2)*b(3) - a(3)*b(2);
    c.v[2] = a(0)*b(2) - a(1)*b(3) + a(2)*b(0) + a(3)*b(1);
    c.v[3] = a(0)*b(3) + a(1)*b(2) - a(2)*b(1) + a(3)*b(0);
}
namespace OrthoSys { static Vec3_t e0(1, 0, 0), e1(0, 1, 0), e2(0, 0, 1); }
template <typename T> struct Array {
    std::vector<T> all;
    size_t Size() const { return all.size(); }
    T & operator[](size_t i) { return all[i]; }
};
namespace DEM {
typedef void (*ptFun_t)(void);
struct ParticleProps { double m = 1, Kn = 0, Kt = 0, Gn = 0, Mu = 0; };
struct Particle {
    int Tag;
    Vec3_t x, Ff;
    Quaternion_t turn = {{1, 0, 0, 0}};
    Quaternion_t Q = {{std::sqrt(0.5), 0, 0, std::sqrt(0.5)}};  // as of other axes than the file's
    ParticleProps Props;
    void Rotate(Quaternion_t & q, Vec3_t &) { turn = q; }
    void Translate(Vec3_t & t) { x = t; }
    void FixVeloc(double = 0, double = 0, double = 0) { std::cout << "WALL " << Tag << "\n"; }
};
struct Domain {
    double Alpha = 0;
    Array<Particle *> Particles;
    void AddPlane(int tag, Vec3_t const &, double, double, double, double, double, Vec3_t *) { Add(tag); }
    void AddFromJson(int tag, char const * file, double R, double rho, double scale, bool = false) {
        std::cout.precision(17);
        std::cout << "LOAD " << tag << " " << file << " " << R << " " << rho << " " << scale << "\n";
        Add(tag);
    }
    void Add(int tag) { Particles.all.push_back(new Particle()); Particles.all.back()->Tag = tag; }
    Particle * GetParticle(int tag) {
        for (Particle * p : Particles.all) if (p->Tag == tag) return p;
        return NULL;
    }
    void Solve(double tf, double dt, double, ptFun_t, ptFun_t, char const *, size_t, size_t) {
        for (Particle * p : Particles.all) {
            std::cout << "GRAIN";
            for (Quaternion_t const & q : {p->turn, p->Q}) for (double v : q.v) std::cout << " " << v;
            for (Vec3_t const & t : {p->x, p->Ff}) for (double v : t.v) std::cout << " " << v;
            std::cout << "\n";
        }
        std::cout << "SOLVE " << tf << " " << dt << "\n";
    }
};
}
#define MECHSYS_CATCH catch (std::exception const &) { return 1; }
"""
MECHSYS = {"mechsys/dem/domain.h": _MECHSYS, "mechsys/util/fatal.h": "#include <exception>\n"}
