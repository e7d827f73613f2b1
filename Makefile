# Each target does its own set-up: `make demo` and `make test` start from a bare Debian 12 with Rust.
# Missing packages are installed with apt, as root or through sudo; where that cannot be, they are named.

SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.PHONY: help deps demo test test-all test-rest rust-alone agreement longest test-page test-farm fuzz memcheck lint
.PHONY: bench bench-check scenes book gallery test-docs shell-files deb static wheel test-python lint-workflows clean

# Rust's installer puts cargo here; the shell of a CI system may lack it in its PATH.
export PATH := $(PATH):$(HOME)/.cargo/bin
BUFFON := cargo run --release --locked --quiet --
# What packages are made of, and the tools that make them.
PACKAGE := target/package
CARGO_DEB := target/tools/bin/cargo-deb
PYTHON_TOOLS := target/tools/python
WHEELS := target/wheels
TERRAIN := scenes/terrain/terrain.ply
# The last file that its example writes stands for all of them.
SPEED := scenes/speed/lights-10000.xml
# Both feature sets: with Embree and OpenImageIO, and in Rust alone.
RUST_ALONE := -p buffon --no-default-features
# Without the examples, which clippy compiles, and which take minutes to build.
TESTS := --locked --workspace --lib --bins --tests
# Tests that take too long for continuous integration.
LONGEST := a_bias_that_is_allowed a_hundred_renders_are_killed a_hundred_thousand_lamps a_seed_decides_the_numbers \
    every_experiment_runs irradiance_from_beforehand light_does_not_pass_below_a_wall_with_millions \
    lobes_do_not_change pictures_of_more_seeds refuted_with_any_seed
# What is tested with both: traversal, images, and the command line over them.
TWICE := parity watertight self_intersection image_ texture_files cli:: determinism own_scenes plugins:: memory

# mdBook is built once, into target/tools.
MDBOOK := target/tools/bin/mdbook
MDBOOK_VERSION := 0.5.4

# These are for code that is compiled once, and not again after each change. The first two save a third of the time that
# compiling takes. The last one saves a quarter of the rest.
export CARGO_INCREMENTAL ?= 0
export CARGO_PROFILE_DEV_DEBUG ?= 0
export CARGO_PROFILE_DEV_CODEGEN_UNITS ?= 4

# CPUs without AVX2 get the baseline: RUSTFLAGS replaces the flags of .cargo/config.toml.
ifeq ($(shell uname -m)$(shell grep -m 1 -o -w avx2 /proc/cpuinfo),x86_64)
export RUSTFLAGS := $(RUSTFLAGS) --cfg buffon_baseline
endif

help: ## say what there is to make (this)
	@sed -n 's/^\([a-z-]*\):.* ## /  make \1\t/p' Makefile | expand -t 16

deps: ## install what the build needs and lacks
	@.ci/deps

demo: deps ## build, and render the Cornell box to out/
	cargo build --release --locked
	@mkdir -p out
	$(BUFFON) render scenes/cornell-box/cornell-box.xml -o out/cornell-box.png --stats out/cornell-box.json
	@echo
	@echo "The picture:  $(CURDIR)/out/cornell-box.png"
	@echo "The figures above, and more of them:  $(CURDIR)/out/cornell-box.json"

# What is quickest to fail comes first.
test: lint ## what must hold, in minutes
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --no-deps
	cargo test $(TESTS)

# The tests marked `ignore`, the tests of what depends on the libraries without these, random scenes on which all
# estimators must agree, and the experiments with many seeds.
test-all: test test-docs test-rest rust-alone agreement longest test-python lint-workflows ## everything that must hold

test-rest: deps
	@.ci/deps parallel
	cargo clippy --locked $(RUST_ALONE) --all-targets -- -D warnings
	cargo test $(TESTS) -- --ignored $(LONGEST:%=--skip %)
	cargo test --locked $(RUST_ALONE) --test tests -- --include-ignored $(TWICE)

# `make test` runs nearly the same code, so continuous integration does without these.
rust-alone: deps ## run the unit tests and build the documentation of Buffon without the libraries
	cargo test --locked $(RUST_ALONE) --lib
	RUSTDOCFLAGS="-D warnings" cargo doc --locked $(RUST_ALONE) --no-deps

longest: deps ## run the tests that take longest, and the experiments of `buffon lab` with many seeds
	cargo test --locked -p buffon --test tests -- --ignored $(LONGEST)

agreement: deps ## compare all estimators on 300 random scenes
	cargo run --release --locked --quiet --example agreement -- 300

# A seed of its own for each run; it is printed, and makes the run again.
fuzz: deps ## try mutated scenes, meshes and images for some minutes: SEED=..., CASES=...
	seed=$${SEED:-$$(od -An -N4 -tu4 /dev/urandom | tr -d ' ')}; \
	echo "make fuzz SEED=$$seed CASES=$${CASES:-10000}"; \
	PROPTEST_RNG_SEED=$$seed PROPTEST_CASES=$${CASES:-10000} BUFFON_FUZZ_CASES=$${CASES:-10000} \
	    cargo test --locked -p buffon --test tests -- robustness gltf_errors

# The tests of the Markdown files are part of `make test`, too.
test-docs: deps book ## check the links and commands of the documentation, and the links of the book
	cargo test --locked -p buffon --test tests -- docs_
	cargo test --locked -p buffon --lib -- instantiate::reference
	cargo run --locked --quiet --example check_book -- out/book

# A tiny bench, for the page's sake; its figures mean nothing. The screenshots stay in out/page.
test-page: deps ## open pages of `bench` and `render --watch` in headless Chromium, and check that they work
	@.ci/deps chromium
	@mkdir -p out/page
	XDG_CACHE_HOME=$(CURDIR)/out/cache cargo run --locked --quiet -- bench scenes/cornell-box/cornell-box.xml --size 64x64 \
	    --integrators path,direct --budgets 2,4,8 --runs 2 --reference-time 5s -o out/page
	cargo run --locked --quiet --example check_page -- out/page/index.html out/page
	cargo run --locked --quiet --example check_watch -- target/debug/buffon scenes/cornell-box/cornell-box.xml out/page

test-farm: deps ## render with a Slurm on this machine alone, as root; tasks are killed and requeued
	@.ci/deps slurm-wlm munge
	cargo build --release --locked
	tests/farm/slurm.sh target/release/buffon scenes/cornell-box/cornell-box.xml

# The tests of what is unsafe. Valgrind's CPU has no AVX-512, so every library takes its path for AVX2.
memcheck: deps ## run the tests of the C and C++ interfaces under valgrind
	@.ci/deps valgrind
	host=$$(rustc -vV | sed -n 's/^host: //p'); \
	export CARGO_TARGET_$$(tr a-z- A-Z_ <<<"$$host")_RUNNER="valgrind --quiet --error-exitcode=9 --num-callers=40 \
	    --leak-check=full --show-leak-kinds=definite --errors-for-leak-kinds=definite"; \
	cargo test --locked -p buffon-embree-sys -p buffon-oiio-sys --lib; \
	cargo test --locked -p buffon --lib -- --test-threads=1 embree:: image::; \
	cargo test --locked -p buffon --test tests -- --test-threads=1 embree_ffi:: image_io:: texture_files::

# `make test-rest` has clippy look at what is compiled without the libraries.
lint: deps ## check formatting, and what clippy has to say
	cargo fmt --all --check
	cargo clippy --locked --workspace --all-targets -- -D warnings

bench: deps ## measure
	@.ci/deps valgrind
	cargo bench --locked --bench '*'

# Instructions are nearly the same on every machine; times are not.
bench-check: deps ## count instructions of hot paths, and compare them with those that are known
	@.ci/deps valgrind
	cargo bench --locked --bench instructions

scenes: $(TERRAIN) $(SPEED) ## generate the meshes, textures and scenes that are too large to keep

$(TERRAIN): examples/generate_terrain.rs | deps
	cargo run --release --locked --example generate_terrain -- $@

$(SPEED): examples/speed_scenes.rs | deps
	cargo run --release --locked --example speed_scenes

# The source of the book has the folders of the repository, so that relative links work in both.
book: $(MDBOOK) ## build the documentation as a book with search: out/book/index.html
	rm -rf out/book-src out/book
	@mkdir -p out/book-src
	cp --parents $$(find *.md LICENSE-* docs scenes python/README.md \
	    -name '*.md' -o -name 'LICENSE-*' -o -path 'docs/*' -type f \
	    -o -path 'scenes/*.xml' -o -path 'scenes/*.toml') out/book-src
	mv out/book-src/docs/book.toml out/book-src
	sed -e 's|](\.\./|](|' -e t -e 's|](|](docs/|' docs/SUMMARY.md >out/book-src/SUMMARY.md
	rm out/book-src/docs/SUMMARY.md
	$(MDBOOK) build out/book-src

$(MDBOOK):
	cargo install mdbook --version $(MDBOOK_VERSION) --locked --no-default-features --features search --root target/tools

gallery: scenes ## render the pictures of the documentation: docs/gallery/*.jpg
	cargo build --release --locked
	docs/gallery/render target/release/buffon

# The texts that a package has beside the program.
shell-files: deps
	cargo build --release --locked
	@mkdir -p $(PACKAGE)/completions
	target/release/buffon man --dir $(PACKAGE)/man
	for shell in bash zsh fish; do target/release/buffon completions $$shell >$(PACKAGE)/completions/buffon.$$shell; done
	packaging/licenses | gzip --best --no-name >$(PACKAGE)/third-party.txt.gz

deb: shell-files $(CARGO_DEB) ## make a package for Debian in target/debian
	@.ci/deps dpkg-dev
	rm -f target/debian/buffon_*.deb
	$(CARGO_DEB) --no-build --strip

$(CARGO_DEB):
	cargo install --locked --root target/tools --target-dir target/tools/build cargo-deb@3.8.0

static: ## build one file without libraries, in Rust alone: TARGET=..., else musl if it is installed, else glibc
	packaging/static cargo rustc --release --bin buffon -- -C strip=symbols
	@mkdir -p $(PACKAGE)
	cp target/static/$$(packaging/static)/release/buffon $(PACKAGE)/buffon
	packaging/licenses --no-default-features >$(PACKAGE)/third-party-static.txt
	@ls -l $(CURDIR)/$(PACKAGE)/buffon

wheel: $(PYTHON_TOOLS)/bin/maturin ## make a wheel for Python in target/wheels, with the program of `make static`
	rm -f $(WHEELS)/buffon-*.whl
	packaging/licenses --no-default-features >python/buffon/third-party.txt
	packaging/static $(PYTHON_TOOLS)/bin/maturin build --release --out $(WHEELS)

$(PYTHON_TOOLS)/bin/maturin: packaging/requirements.txt
	@.ci/deps python3-venv
	python3 -m venv $(PYTHON_TOOLS)
	$(PYTHON_TOOLS)/bin/pip install --quiet --requirement packaging/requirements.txt
	@touch $@

test-python: wheel ## test the wheel in an environment of its own, and check its types
	rm -rf target/test-python
	python3 -m venv target/test-python
	target/test-python/bin/pip install --quiet $(WHEELS)/buffon-*.whl pytest mypy
	target/test-python/bin/mypy
	cd python/tests && ../../target/test-python/bin/python -m pytest -q

lint-workflows: $(PYTHON_TOOLS)/bin/maturin ## check the files for GitHub and GitLab against their schemas
	$(PYTHON_TOOLS)/bin/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml \
	    docs/ci/github*.yml
	$(PYTHON_TOOLS)/bin/check-jsonschema --builtin-schema vendor.gitlab-ci docs/ci/gitlab*.yml

clean: ## remove what was built, rendered and generated
	rm -rf out $(TERRAIN) $(addprefix scenes/speed/,*.png *.exr *.vol lights-*.xml)
	if command -v cargo >/dev/null; then cargo clean; fi
