"""`docs/monitoring.md`, alert rules and dashboard are printed from one table."""

from pathlib import Path

from tools.monitoring import ALERTS, alert_rules, dashboard, metrics, monitoring_page

_ROOT = Path(__file__).parents[3]


def test_all_three_are_up_to_date() -> None:
    wanted = {
        "docs/monitoring.md": monitoring_page(),
        "deploy/monitoring/alerts.json": alert_rules(),
        "deploy/monitoring/dashboard.json": dashboard(),
    }
    for name, text in wanted.items():
        assert (_ROOT / name).read_text(encoding="utf-8") == text, f"{name}: run make generated"


def test_every_figure_and_alert_is_on_the_page() -> None:
    page = monitoring_page()
    assert all(f"| `{one.name}` |" in page and one.documentation for one in metrics())
    assert all(f"| `{alert.name}` |" in page for alert in ALERTS)


def test_prometheus_finds_the_rules_beside_its_configuration() -> None:
    assert "- alerts.json" in (_ROOT / "deploy" / "monitoring" / "prometheus.yml").read_text()
