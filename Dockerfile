# docker build -t streamdash . && docker run --rm -p 5006:5006 streamdash   →   http://localhost:5006
FROM python:3.11-slim AS build
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
RUN python -m venv /opt/venv
WORKDIR /srv/streamdash
# The packages' names and the version are enough for an editable install; the code comes last, so
# that changing it does not install the dependencies again.
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY streamdash/__init__.py streamdash/
RUN mkdir app && /opt/venv/bin/pip install -c constraints.txt -e .
# A fifth of the environment is the libraries' own tests and source maps, which nothing imports.
# astropy itself imports the folder of its test runner.
RUN find /opt/venv -type d -name tests -not -path '*/astropy/tests' -prune -exec rm -rf {} + && find /opt/venv -name '*.map' -delete

FROM python:3.11-slim
RUN useradd --uid 10001 --create-home streamdash
ENV PATH=/opt/venv/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    NUMBA_CACHE_DIR=/home/streamdash/.cache/numba
COPY --from=build /opt/venv /opt/venv
WORKDIR /srv/streamdash
COPY pyproject.toml README.md LICENSE ./
COPY cache cache
COPY docs docs
COPY streamdash streamdash
COPY app app
USER streamdash
# What people simulate is kept here; mount a volume to keep it longer than the container.
RUN mkdir -p /home/streamdash/.local/share/streamdash
VOLUME /home/streamdash/.local/share/streamdash
EXPOSE 5006
# /liveness answers without creating a session, which a GET of / would.
HEALTHCHECK --interval=30s --timeout=5s --start-period=60s \
    CMD ["python", "-c", "import urllib.request as r; r.urlopen('http://127.0.0.1:5006/liveness', timeout=4)"]
CMD ["streamdash", "serve", "--address", "0.0.0.0", "--port", "5006"]
